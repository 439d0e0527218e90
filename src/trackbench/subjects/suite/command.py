"""The commands of ``trackbench suite``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from trackbench import results
from trackbench.base.errors import InputError, counted
from trackbench.base.exit_status import FAILED_PLUGIN
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import (
    FAILED_EXPECTATION,
    WORKERS,
    artifact_options,
    isolation_options,
    names_in,
    out_option,
)
from trackbench.cli.run_output import RunOutput
from trackbench.cli.terminal import quiet_option
from trackbench.driving.isolation import Isolation

if TYPE_CHECKING:
    from trackbench.subjects.suite.make import EntryMaker

workers_option = click.option(
    "--workers", type=WORKERS, metavar="N", help="Processes; default: one per core if faster. Same result."
)
suite_option = click.option("--suite", type=click.Path(path_type=Path), metavar="FILE", help="File of your own suite.")
cluster_option = click.option("--cluster", metavar="ADDRESS", help="Dask cluster: tcp://HOST:PORT or local:N.")


@click.group("suite")
def suite_command() -> None:
    """Enter a tracker in a suite, and check an entry.

    The scenarios of a suite never change. An entry has a tracker's estimates in them, and scores that anyone can check.

    \b
    Example:
      trackbench suite run trackbench-road-1 mine.yaml --only smoke
    """


@suite_command.command("list")
@click.argument("argument", required=False, metavar="[ID]")
def list_command(argument: str | None) -> None:
    """Show the suites, or the scenarios and trackers of one.

    \b
    Example:
      trackbench suite list trackbench-road-1
    """
    from trackbench.subjects.suite.suite import find_suite, shipped_suites

    if argument is None:
        for name in shipped_suites():
            print_answer(f"{name:18}  {find_suite(name).stated.title}\n{'':18}  trackbench suite list {name}")
        return
    suite = find_suite(argument)
    stated = suite.stated
    print_answer(f"{stated.id}, version {stated.version}: {stated.title}\nsha256 {suite.sha256}\n")
    for name, item in suite.scenarios.items():
        config = item.plain.config
        scenes, runs = len(config.truth.scenes()), config.monte_carlo.runs
        extent = f"{item.kind}, {counted(scenes, 'scene')} x {counted(runs, 'run')}, seed {config.monte_carlo.seed}"
        print_answer(f"{name:18}  {extent}{', smoke' if name in stated.smoke else ''}: {config.description}")
    for kind, trackers in stated.trackers.items():
        print_answer(f"\nbuilt-in trackers, {kind}: {', '.join(trackers)}")


@suite_command.command("run")
@click.argument("argument", metavar="ID")
@click.argument("trackers", nargs=-1, required=True, metavar="TRACKER...")
@click.option("--only", metavar="A,B", help="Only these scenarios: ids, single, traffic, smoke.")
@out_option("Folder in which each entry gets a folder.", "entries")
@workers_option
@cluster_option
@isolation_options
@artifact_options
@quiet_option("Print only the folders of the entries.")
def run_command(
    argument: str,
    trackers: tuple[str, ...],
    only: str | None,
    out: Path,
    workers: int | None,
    cluster: str | None,
    isolation: Isolation,
    left_out: frozenset[str],
    quiet: bool,
) -> None:
    """Enter trackers in a suite.

    TRACKER is a YAML file that says who it is, module:Class, or a built-in tracker of the suite. An entry is written
    whole or not at all.

    \b
    Examples:
      trackbench suite run trackbench-road-1 mine.yaml
      trackbench suite run trackbench-road-1 ekf_cv pmb --only smoke

    \b
    Exit status: 1 a bound was beaten, 3 a tracker failed
    """
    from trackbench.base.execution import executor
    from trackbench.subjects.suite.entry import ENTRY
    from trackbench.subjects.suite.make import EntryMaker, TrackerFailedError
    from trackbench.subjects.suite.suite import find_suite
    from trackbench.subjects.suite.tracker import find_tracker

    suite = find_suite(argument)
    chosen, output = suite.chosen(names_in(only or "")), RunOutput(False, quiet)
    entering = [find_tracker(each, suite) for each in trackers]
    names = [tracker.name for tracker in entering]
    if len({*names}) < len(names):
        raise InputError("two trackers have the same name; each has a folder of its name", key="TRACKER")
    results.require_writable(out)
    for name in names:
        results.require_replaceable(out / name, ENTRY)
    with executor(workers, cluster) as chosen_executor:
        makers = [EntryMaker(suite, each, chosen_executor, isolation, output, left_out) for each in entering]
        scenarios = [maker.check(chosen) for maker in makers]
        for maker, entered in zip(makers, scenarios, strict=True):
            try:
                maker.make(entered, out / maker.tracker.name)
            except TrackerFailedError as error:
                click.echo(str(error), err=True)
                raise click.exceptions.Exit(FAILED_PLUGIN) from None
            _print_entry(maker, out / maker.tracker.name, quiet)
    beaten = [maker for maker in makers if any(not result.summary.passed for result in maker.results.values())]
    raise click.exceptions.Exit(FAILED_EXPECTATION if beaten else 0)


@suite_command.command("verify")
@click.argument("entry", type=click.Path(path_type=Path), metavar="ENTRY")
@suite_option
@workers_option
@cluster_option
@isolation_options
@click.option("--json", "as_json", is_flag=True, help="Print the checks as JSON, and nothing else.")
@quiet_option("Only what failed.")
def verify_command(
    entry: Path,
    suite: Path | None,
    workers: int | None,
    cluster: str | None,
    isolation: Isolation,
    as_json: bool,
    quiet: bool,
) -> None:
    """Check an entry, and say what is taken on trust.

    Files, truth, scans and scores are checked; where the tracker is here (in ENTRY, the working directory or
    installed), a tenth of the scenes is run again.

    \b
    Example:
      trackbench suite verify entries/mine

    \b
    Exit status: 1 something is wrong
    """
    from trackbench.base.execution import executor
    from trackbench.subjects.suite.entry import read_entry
    from trackbench.subjects.suite.verify import Verifier

    stored = read_entry(entry, suite)
    with executor(workers, cluster) as chosen:
        checks = [*Verifier(stored, chosen, isolation, RunOutput(as_json, quiet)).checks()]
    failed = [check for check in checks if check.outcome == "failed"]
    if as_json:
        values = {"entry": str(entry), "passed": not failed, "checks": [check._asdict() for check in checks]}
        print_answer(results.json_text(values), nl=False)
    else:
        for check in failed if quiet else checks:
            print_answer(f"{check.outcome:8}  {check.what:8}  {check.text}")
        was_rerun = any((check.outcome, check.what) == ("checked", "rerun") for check in checks)
        verdict = "verified" if was_rerun else "verified, but no run was made again"
        verdict = f"not verified: {counted(len(failed), 'check')} failed" if failed else verdict
        print_answer(f"{stored.entry.tracker.name} in {stored.entry.suite.id}: {verdict}")
    raise click.exceptions.Exit(FAILED_EXPECTATION if failed else 0)


@suite_command.command("merge")
@click.argument("entries", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="ENTRY...")
@suite_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Also write a file, .html or .json.")
def merge_command(entries: tuple[Path, ...], suite: Path | None, out: Path | None) -> None:
    """Compare entries, made on any machines.

    Noise is the same, so differences are paired. Nothing is run again; verify each entry first.

    \b
    Example:
      trackbench suite merge entries/mine theirs/pmb --out comparison.html
    """
    from rich.console import Console

    from trackbench.document.files import require_ending
    from trackbench.document.terminal import print_document
    from trackbench.report.comparison.document import ENDINGS, comparison_document, comparison_files
    from trackbench.subjects.suite.merge import merged_entries

    if out is not None:
        require_ending(out, ENDINGS, "--out")
        results.require_file(out, "--out")
    comparison = merged_entries(entries, suite).comparison
    for file, content in comparison_files(comparison, out) if out is not None else ():
        results.write_bytes(file, content)
    print_document(comparison_document(comparison), Console(file=answer()))


@suite_command.command("page")
@click.argument("folder", type=click.Path(path_type=Path), metavar="FOLDER")
@suite_option
def page_command(folder: Path, suite: Path | None) -> None:
    """Write the page of a folder of entries.

    The files are index.html, index.md, suite.bib and CITATION.cff.

    \b
    Example:
      trackbench suite page entries
    """
    from trackbench.subjects.suite.merge import merged_entries
    from trackbench.subjects.suite.page import entries_in, page_files

    files = page_files(merged_entries([*entries_in(folder)], suite), folder)
    for name, content in files.items():
        results.write_bytes(folder / name, content.encode())
    print_answer(f"{folder}/: {', '.join(files)}")


def _print_entry(maker: EntryMaker, folder: Path, quiet: bool) -> None:
    """Print the scores of an entry, and the command that checks it."""
    for name, result in () if quiet else maker.results.items():
        (tracker,) = result.summary.trackers
        why = result.why_unscored(tracker)
        metric = tracker.metrics[result.summary.headline]
        print_answer(f"{name:20} {result.summary.headline_name} {metric}{f'; not ranked: {why}' if why else ''}")
    print_answer(f"{folder}/: entry.json, {counted(len(maker.results), 'scenario')}")
    if not quiet:
        print_answer(f"check it: trackbench suite verify {folder}")

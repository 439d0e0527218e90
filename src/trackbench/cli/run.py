"""``trackbench run``"""

from __future__ import annotations

import json
import math
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from trackbench import results
from trackbench.cli.completion import scenario_paths, trackers_of_scenarios
from trackbench.cli.live import live_options, showing
from trackbench.cli.progress import progress
from trackbench.cli.volume import quiet_option, verbose_option
from trackbench.errors import InputError, nearest
from trackbench.palette import tracker_colours
from trackbench.results import Result
from trackbench.scenario import LoadedScenario, load_scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.truth import truth_of
from trackbench.truth import LoadedTruth
from trackbench.types import Progress

if TYPE_CHECKING:
    from trackbench.recording.live import Live

FAILED_EXPECTATION = 1
FAILED_TRACKER = 3
#: Where a run that goes on until its precision is reached stops even so.
MAX_RUNS = 10_000


@dataclass(frozen=True)
class Prepared:
    """A scenario that nothing can stop any more but its own trackers."""

    loaded: LoadedScenario
    truth: LoadedTruth
    command: Callable[[LoadedScenario], str]
    """What reproduces the result of the scenario with as many runs as were made in the end."""


@dataclass(frozen=True)
class Talk:
    """What a run says, and where: the result to stdout unless that is JSON."""

    console: Console
    as_json: bool
    quiet: bool


@dataclass(frozen=True)
class Plan:
    """How every scenario is run."""

    out: Path
    workers: int
    recording: bool
    precision: tuple[float, int] | None
    """The share and the largest number of runs, where the precision decides on their number."""
    viewer: Live | None


Writer = Callable[[Path], None]


@click.command("run")
@click.argument(
    "scenarios",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="SCENARIO.yaml...",
    shell_complete=scenario_paths,
)
@click.option("--runs", type=click.IntRange(1), metavar="N", help="Monte-Carlo runs, instead of the scenario's.")
@click.option(
    "--runs-until",
    type=click.FloatRange(0, 1, min_open=True),
    metavar="SHARE",
    help="Until the lead is known to this share.",
)
@click.option("--max-runs", type=click.IntRange(2, 1_000_000), metavar="N", help=f"Where to stop even so; {MAX_RUNS}.")
@click.option("--seed", type=click.IntRange(0), metavar="S", help="Seed of the noise, instead of the scenario's.")
@click.option(
    "--trackers", metavar="A,B", shell_complete=trackers_of_scenarios, help="Only these of the scenario's trackers."
)
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    default=Path("results"),
    show_default=True,
    help="Each scenario gets a folder in it.",
)
@click.option("--workers", type=click.IntRange(1), metavar="N", default=1, help="Processes; same result.")
@click.option("--no-recording", is_flag=True, help="Do not write the Rerun recording.")
@click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help="Write the expectations as JUnit XML.")
@live_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
@quiet_option("One line a scenario, and what failed.")
@verbose_option
def run_command(
    scenarios: tuple[Path, ...],
    runs: int | None,
    runs_until: float | None,
    max_runs: int | None,
    seed: int | None,
    trackers: str | None,
    settings: tuple[str, ...],
    out: Path,
    workers: int,
    no_recording: bool,
    junit: Path | None,
    as_json: bool,
    quiet: bool,
    **live: Any,
) -> None:
    """Score every tracker; write a result, a report and a recording.
    A folder stands for the scenarios in it; several are also compared.

    \b
    Examples:
      trackbench run scenarios/highway.yaml --runs 1000 --workers 2
      trackbench run scenarios/ --set score.settle_s=2 --runs-until 0.01

    \b
    Exit status: 0 expectations met, 1 one failed, 2 bad input, 3 a tracker failed
    """
    if runs_until is not None and (runs is not None or not math.isfinite(runs_until)):
        raise InputError("give a share between 0 and 1, and no --runs beside it", key="--runs-until")
    if max_runs is not None and runs_until is None:
        raise InputError("is where --runs-until stops, which is not given", key="--max-runs")
    precision = None if runs_until is None else (runs_until, max_runs or MAX_RUNS)
    overrides = [
        *settings,
        *([] if runs is None else [f"monte_carlo.runs={runs}"]),
        *([] if seed is None else [f"monte_carlo.seed={seed}"]),
    ]
    chosen = None if trackers is None else [name.strip() for name in trackers.split(",")]
    files = list(scenario_files(scenarios))
    results.require_writable(out)
    if junit is not None:
        results.require_file(junit, "--junit")
    prepared = [
        prepare(file, overrides, chosen, precision, of=_place(i, files), quiet=quiet)
        for i, file in enumerate(files, start=1)
    ]
    _require_distinct(prepared)
    for item in prepared:
        results.require_replaceable(out / item.loaded.config.name)
    talk = Talk(Console(), as_json, quiet)
    with showing(**live) as viewer:
        plan = Plan(out, workers, not no_recording, precision, viewer)
        found = [_run(item, plan, talk, _place(i, files)) for i, item in enumerate(prepared, start=1)]
        if len(found) > 1:
            _compare(found, out, talk)
        if junit is not None:
            _write_junit(found, junit)
        if as_json:
            summaries: Any = [result.json() for result in found]
            click.echo(json.dumps(summaries[0] if len(found) == 1 else summaries, indent=2, allow_nan=False))
    raise click.exceptions.Exit(status([result.json() for result in found]))


def scenario_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files that are named, and those in the folders that are named."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        inside = sorted(path.glob("*.y*ml"))
        if not inside:
            raise InputError("there is no scenario file (*.yaml) in this folder", file=path)
        yield from inside


def prepare(
    file: Path,
    overrides: Sequence[str],
    chosen: Sequence[str] | None,
    precision: tuple[float, int] | None = None,
    *,
    of: str = "",
    quiet: bool = False,
) -> Prepared:
    """Read, check and simulate what a scenario needs before any tracker runs.

    Args:
        file: the scenario.
        overrides: ``key.path=value`` each.
        chosen: names of the trackers to run; all unless given.
        precision: the share and the largest number of runs, where the precision decides on their number.
        of: which of several scenarios this is, as the progress shows it.
        quiet: show no progress.
    """
    loaded = load_scenario(file, overrides)
    if precision is not None:
        from trackbench.runner.until import first_look

        loaded = first_look(loaded, precision[1])
    if chosen is not None:
        loaded = _only(loaded, chosen)
    if precision is not None and len(loaded.config.trackers) < 2:
        raise InputError("needs two trackers, whose difference it is about", file=file, key="--runs-until")
    check_plugins(loaded)
    with progress(f"{of}truth of {loaded.config.name}", "steps", quiet=quiet) as advance:
        truth = truth_of(loaded, advance)
    for note in truth.notes:
        click.echo(note, err=True)
    only = [] if chosen is None else ["--trackers", ",".join(chosen)]

    def command(made: LoadedScenario) -> str:
        settings = (x for item in made.overrides for x in ("--set", item))
        return shlex.join(["trackbench", "run", str(file), *settings, *only])

    return Prepared(loaded, truth, command)


def status(summaries: Sequence[dict[str, Any]]) -> int:
    """The exit status of finished runs."""
    if any(tracker["failed"] for summary in summaries for tracker in summary["trackers"]):
        return FAILED_TRACKER
    return 0 if all(summary["passed"] for summary in summaries) else FAILED_EXPECTATION


def _place(number: int, files: Sequence[Path]) -> str:
    return f"{number} of {len(files)}: " if len(files) > 1 else ""


def _only(loaded: LoadedScenario, chosen: Sequence[str]) -> LoadedScenario:
    """The scenario with some of its trackers, and the expectations that can still be judged.

    The name of a sweep stands for all of its points.
    """
    config = loaded.config
    for name in chosen:
        if name not in config.trackers and name not in loaded.sweeps:
            problem = f"no tracker {name!r} in this scenario; {nearest(name, [*config.trackers, *loaded.sweeps])}"
            raise InputError(problem, key="--trackers", file=loaded.path)
    wanted = {point for name in chosen for point in loaded.sweeps.get(name, (name,))}
    kept = {name: tracker for name, tracker in config.trackers.items() if name in wanted}
    expect = [item for item in config.expect if {item.tracker, item.better_than or item.tracker} <= set(kept)]
    return replace(loaded, config=config.model_copy(update={"trackers": kept, "expect": expect}))


def _require_distinct(prepared: Sequence[Prepared]) -> None:
    """Two scenarios of one name would overwrite each other."""
    by_name: dict[str, Path] = {}
    for item in prepared:
        name, path = item.loaded.config.name, item.loaded.path
        if name in by_name:
            problem = f"{by_name[name]} has the same name {name!r}; give each scenario its own"
            raise InputError(problem, file=path, key="name")
        by_name[name] = path


def _run(
    item: Prepared,
    plan: Plan,
    talk: Talk,
    of: str,
) -> Result:
    from trackbench import recording
    from trackbench.report import html, markdown
    from trackbench.report.console import print_outcome, print_summary
    from trackbench.runner.run import run
    from trackbench.runner.until import run_until

    name = item.loaded.config.name
    observer = None
    if plan.viewer is not None:
        plan.viewer.begin(item.loaded, item.truth.truth)
        observer = plan.viewer.observe
    # What a tracker prints is no part of the result.
    with redirect_stdout(sys.stderr), progress(f"{of}{name}", "runs", quiet=talk.quiet) as advance:
        told: Any = {"workers": plan.workers, "progress": advance, "observer": observer}
        if plan.precision is None:
            result = run(item.loaded, item.truth, command=item.command(item.loaded), **told)
        else:
            result = run_until(item.loaded, item.truth, *plan.precision, command=item.command, **told)
    folder = plan.out / name
    artifacts: dict[str, Writer] = {
        "report.html": partial(_write_report, html.render, result),
        "report.md": partial(_write_report, markdown.render, result),
    }
    if plan.recording:
        artifacts["recording.rrd"] = partial(recording.write, result)
    files = (*artifacts, *(f"{table}.parquet" for table in result.tables))
    result = result.updated(artifacts={"markdown" if file == "report.md" else Path(file).stem: file for file in files})
    with progress(f"{of}writing {name}", "files", quiet=talk.quiet) as advance:
        result.save(folder, _counted(artifacts, advance))
    if plan.viewer is not None:
        plan.viewer.end(result)
    if talk.as_json:
        return result
    if talk.quiet:
        print_outcome(result, talk.console)
        return result
    print_summary(result, talk.console)
    shown = ", ".join([results.SUMMARY, *artifacts])
    talk.console.print(f"[dim]{folder}/: {shown}[/dim]\n", highlight=False, soft_wrap=True)
    return result


def _counted(artifacts: Mapping[str, Writer], advance: Progress) -> dict[str, Writer]:
    """The same writers, each of which says which of them it is."""

    def write(number: int, writer: Writer, path: Path) -> None:
        advance(number, len(artifacts))
        writer(path)

    return {name: partial(write, number, writer) for number, (name, writer) in enumerate(artifacts.items())}


def _write_junit(found: Sequence[Result], path: Path) -> None:
    from trackbench.report.junit import suite_of_run, to_xml

    results.write_text(path, to_xml([suite_of_run(result) for result in found]))


def _write_report(render: Any, result: Result, path: Path) -> None:
    path.write_text(render(result), encoding="utf-8")


def _compare(found: list[Result], out: Path, talk: Talk) -> None:
    from trackbench.compare import compare, results_in
    from trackbench.report.comparison import batch_files

    compared = compare([results_in(out, found)])
    for file, content in batch_files(compared, out, tracker_colours(compared.trackers)):
        file.parent.mkdir(parents=True, exist_ok=True)
        results.write_bytes(file, content)
    if not talk.as_json and not talk.quiet:
        line = f"Comparison of {len(found)} scenarios: {out / 'comparison.md'}"
        talk.console.print(line, highlight=False, soft_wrap=True)

"""Command ``trackbench run``: options, call of the runs, exit status."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from trackbench import results
from trackbench.api.plan import RunPlan
from trackbench.api.run import run_scenarios
from trackbench.api.scenario import load_several
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.base.exit_status import FAILED_PLUGIN
from trackbench.cli.answer import print_answer
from trackbench.cli.commands import RUN_SUMMARY
from trackbench.cli.options import (
    FAILED_EXPECTATION,
    WORKERS,
    artifact_options,
    engine_option,
    followers,
    isolation_options,
    junit_option,
    names_in,
    out_option,
    scenarios_argument,
    subject_options,
    write_suites,
)
from trackbench.cli.run_output import RunOutput
from trackbench.cli.terminal import quiet_option, verbose_option
from trackbench.driving.isolation import Isolation
from trackbench.engine.choice import EngineName
from trackbench.results import Result
from trackbench.scenario.shipped import files_of_scenarios
from trackbench.scenario.worlds import WORLDS
from trackbench.truth import MAX_SCENES

_HELP = f"""{RUN_SUMMARY}
SCENARIO is a YAML file, a folder of them, or the name of one that comes
with trackbench; several are also compared.

\b
Examples:
  trackbench run highway --runs 1000 --workers 2
  trackbench run scenarios/ --set score.settle_s=2

\b
Exit status: 0 expectations met, 1 one failed or undecided, or a bound was
beaten, 2 bad input, 3 a tracker failed, 4 cannot write
"""


@click.command("run", help=_HELP)
@scenarios_argument
@click.option("--runs", type=click.IntRange(1), metavar="N", help="Monte-Carlo runs, instead of the scenario's.")
@click.option("--seed", type=click.IntRange(0), metavar="S", help="Seed of the noise, instead of the scenario's.")
@click.option("--scenes", type=click.IntRange(1, MAX_SCENES), metavar="N", help="Number of scenes (truth.seeds).")
@click.option("--trackers", metavar="A,B", help="Only these of the scenario's trackers.")
@click.option(
    "--worlds",
    metavar="A,B",
    help="Run in each of these worlds: ideal, human, typical, recorded.",
)
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@out_option("Folder in which each scenario gets a folder.", "results")
@click.option("--workers", type=WORKERS, metavar="N", help="Processes; default: one per core if faster. Same result.")
@click.option("--cluster", metavar="ADDRESS", help="Dask cluster: tcp://HOST:PORT or local:N.")
@engine_option
@isolation_options
@artifact_options
@junit_option("Write the expectations as JUnit XML.")
@subject_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
@click.option("--wide", is_flag=True, help="Show velocity, reference, groups and step time too.")
@quiet_option("Print one line per scenario, and what failed.")
@verbose_option
def run_command(
    scenarios: tuple[Path, ...],
    runs: int | None,
    seed: int | None,
    scenes: int | None,
    trackers: str | None,
    worlds: str | None,
    settings: tuple[str, ...],
    out: Path,
    workers: int | None,
    cluster: str | None,
    engine: EngineName,
    isolation: Isolation,
    left_out: frozenset[str],
    junit: Path | None,
    as_json: bool,
    wide: bool,
    quiet: bool,
    **of_subjects: Any,
) -> None:
    """Score every tracker."""
    only = None if trackers is None else names_in(trackers)
    plan = RunPlan(out, workers, cluster, left_out, isolation, engine)
    if junit is not None:
        results.require_file(junit, "--junit")
    files = files_of_scenarios(scenarios)
    options: dict[str, Any] = {"runs": runs, "seed": seed, "scenes": scenes, "trackers": only}
    in_worlds = names_in(worlds or "")
    if worlds is not None and not in_worlds:
        raise InputError(f"name at least one of {', '.join(WORLDS)}", key="--worlds")
    loaded, unchanged = load_several(files, settings, worlds=in_worlds, **options)
    output = RunOutput(as_json, quiet, wide=wide)
    for note in unchanged:
        output.note(note)
    with executor(workers, cluster) as chosen, followers(loaded, of_subjects) as output.followers:
        finished = run_scenarios(loaded, plan, chosen, output)
        if junit is not None:
            from trackbench.report.junit import suite_of_run

            write_suites(list(map(suite_of_run, finished)), junit)
        if as_json:
            summaries: Any = [result.json() for result in finished]
            print_answer(json.dumps(summaries[0] if len(finished) == 1 else summaries, indent=2, allow_nan=False))
    raise click.exceptions.Exit(status(finished))


def status(finished: Sequence[Result]) -> int:
    """Return the exit status: that of a failed tracker if there is one, else of a failed expectation, else 0."""
    if any(tracker.failed for result in finished for tracker in result.summary.trackers):
        return FAILED_PLUGIN
    return 0 if all(result.summary.passed for result in finished) else FAILED_EXPECTATION

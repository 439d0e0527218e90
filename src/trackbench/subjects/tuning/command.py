"""The command ``trackbench tune``."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from trackbench import results
from trackbench.api.scenario import load_several
from trackbench.base.execution import executor
from trackbench.cli.answer import answer, print_answer
from trackbench.cli.options import (
    WORKERS,
    engine_option,
    isolation_options,
    names_in,
    scenarios_argument,
)
from trackbench.cli.run_output import RunOutput
from trackbench.cli.terminal import if_interrupted, quiet_option, verbose_option
from trackbench.driving.isolation import Isolation
from trackbench.engine.choice import EngineName
from trackbench.scenario.shipped import files_of_scenarios


@click.command("tune")
@scenarios_argument
@click.option("--trackers", metavar="A,B", help="Trackers to tune.  [the only one with options]")
@click.option(
    "--range", "ranges", multiple=True, metavar="KEY=LOW:HIGH", help="Option and range, or KEY=A,B,C; repeatable."
)
@click.option(
    "--objective",
    metavar="NAME",
    help="What to optimise: likelihood, position_rmse, tgospa, or a metric of the scenario.  [tgospa with "
    "hidden identities and a truth, else likelihood]",
)
@click.option("--trials", type=click.IntRange(2, 100_000), metavar="N", help="Number of sets of values to try.")
@click.option(
    "--storage", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="File that keeps the trials."
)
@click.option("--train-scenes", type=click.IntRange(1, 1000), metavar="N", help="Number of scenes for tuning.")
@click.option("--test-scenes", type=click.IntRange(1, 1000), metavar="N", help="Number of scenes for the test.")
@click.option("--train-runs", type=click.IntRange(1), metavar="N", help="Runs of each scene for tuning.")
@click.option("--test-runs", type=click.IntRange(1), metavar="N", help="Runs of each scene for the test.")
@click.option("--seed", type=click.IntRange(0), metavar="S", default=0, help="Seed of the search.")
@click.option("--set", "settings", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="File of the scenario with the tuned values, or a folder.  [tuned.yaml; for several the folder tuned]",
)
@click.option("--workers", type=WORKERS, metavar="N", default=1, help="Number of processes; same result.")
@engine_option
@isolation_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
@quiet_option("Print only the verdict on each tracker.")
@verbose_option
def tune_command(
    scenarios: tuple[Path, ...],
    trackers: str | None,
    ranges: tuple[str, ...],
    objective: str | None,
    trials: int | None,
    storage: Path | None,
    seed: int,
    settings: tuple[str, ...],
    out: Path | None,
    workers: int,
    engine: EngineName,
    isolation: Isolation,
    as_json: bool,
    quiet: bool,
    **split: int | None,
) -> None:
    """Find the options with which trackers do best.

    Each tracker is tuned by itself, with one set of values for all scenarios. The tuned values are then compared with
    the scenario's values on other scenes and noise. Writes the scenario with the tuned values, a report and all
    numbers. With --storage an interrupted search goes on where it was.

    \b
    Examples:
      trackbench tune highway --trackers ukf_ctrv --out tuned
      trackbench tune u_turn racetrack --trackers ekf_cv --storage study.db

    \b
    Exit status: 0 tuned, 2 bad input, 4 cannot write
    """
    from trackbench.document.terminal import print_document
    from trackbench.subjects.tuning.api import TunePlan, command_of_tuning, tune_trackers
    from trackbench.subjects.tuning.files import default_out, require_tuning_files, save_tuning, tuning_content
    from trackbench.subjects.tuning.held_out import Split
    from trackbench.subjects.tuning.objectives import objective_of
    from trackbench.subjects.tuning.parameters import only_tunable
    from trackbench.subjects.tuning.report import tuning_headline, tuning_summary
    from trackbench.subjects.tuning.study import require_optuna

    require_optuna()
    loaded, notes = load_several(files_of_scenarios(scenarios), settings)
    plan = TunePlan(objective_of(objective, loaded), ranges, trials, seed, storage, Split(**split), isolation, engine)
    names = names_in(trackers) if trackers else [only_tunable(loaded)]
    out = out or default_out(loaded)
    if len(loaded) == 1 and not out.suffix:
        out /= default_out(loaded)
    require_tuning_files(out, loaded)
    output = RunOutput(as_json, quiet)
    for note in notes:
        output.note(note)
    command = command_of_tuning(loaded, names, plan, out)
    resumption = "" if storage is None else f"the trials so far are kept; the same command goes on from {storage}"
    with executor(workers, None) as chosen, if_interrupted(resumption):
        tunings = tune_trackers(loaded, names, plan, chosen, output)
    files = save_tuning(tunings, loaded, out, command)
    if as_json:
        print_answer(results.json_text(tuning_content(tunings, command)), nl=False)
        return
    if quiet:
        for item in tunings:
            print_answer(f"{item.tracker}: {tuning_headline(item)[0]}")
        return
    print_document(tuning_summary(tunings), Console(file=answer()))
    print_answer(f"\n{', '.join(map(str, files))}")

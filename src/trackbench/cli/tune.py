"""``trackbench tune``"""

from __future__ import annotations

from pathlib import Path

import click

from trackbench import results
from trackbench.api.scenario import load_several
from trackbench.cli.completion import scenario_paths, trackers_of_scenarios
from trackbench.cli.isolation import isolation_options
from trackbench.cli.run_output import RunOutput
from trackbench.cli.verbosity import quiet_option, verbose_option
from trackbench.execution import executor
from trackbench.scenario.shipped import scenario_files
from trackbench.stepping.isolation import Isolation


@click.command("tune")
@click.argument(
    "scenarios",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="SCENARIO...",
    shell_complete=scenario_paths,
)
@click.option("--trackers", required=True, metavar="A,B", shell_complete=trackers_of_scenarios, help="Tune these.")
@click.option("--range", "ranges", multiple=True, metavar="KEY=LOW:HIGH", help="An option and its range, or KEY=A,B,C.")
@click.option("--objective", metavar="NAME", help="likelihood, position_rmse, consistent_rmse, gospa or pareto.")
@click.option("--trials", type=click.IntRange(2, 100_000), metavar="N", help="How many values are tried.")
@click.option(
    "--storage", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="Keep the trials: SQLite."
)
@click.option("--train-scenes", type=click.IntRange(1), metavar="N", help="Scenes that are tuned on.")
@click.option("--test-scenes", type=click.IntRange(1), metavar="N", help="Scenes that are tried on.")
@click.option("--train-runs", type=click.IntRange(1), metavar="N", help="Runs of each scene that is tuned on.")
@click.option("--test-runs", type=click.IntRange(1), metavar="N", help="Runs of each scene that is tried on.")
@click.option("--train-seed", type=click.IntRange(0), metavar="S", help="Seed of the noise that is tuned on.")
@click.option("--test-seed", type=click.IntRange(0), metavar="S", help="Seed of the noise that is tried on.")
@click.option("--seed", type=click.IntRange(0), metavar="S", default=0, help="Seed of the search.")
@click.option("--set", "changes", multiple=True, metavar="KEY.PATH=VALUE", help="Change a key of the scenario.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    default=Path("tuned.yaml"),
    show_default=True,
    help="The scenario with the found values; a folder for several.",
)
@click.option("--workers", type=click.IntRange(1), metavar="N", default=1, help="Processes; same result.")
@isolation_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else.")
@quiet_option("One line a tracker.")
@verbose_option
def tune_command(
    scenarios: tuple[Path, ...],
    trackers: str,
    ranges: tuple[str, ...],
    objective: str | None,
    trials: int | None,
    storage: Path | None,
    train_scenes: int | None,
    test_scenes: int | None,
    train_runs: int | None,
    test_runs: int | None,
    train_seed: int | None,
    test_seed: int | None,
    seed: int,
    changes: tuple[str, ...],
    out: Path,
    workers: int,
    isolation: Isolation,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find the options with which trackers do best."""
    from trackbench.api.tune import TunePlan, objective_of, tune_trackers
    from trackbench.tuning.parameters import settings
    from trackbench.tuning.split import Split
    from trackbench.tuning.write_back import written

    loaded, _ = load_several(scenario_files(scenarios), changes)
    split = Split(train_scenes, test_scenes, train_runs, test_runs, train_seed, test_seed)
    plan = TunePlan(objective_of(objective, loaded), ranges, trials, seed, storage, split, isolation)
    names = [name for item in trackers.split(",") if (name := item.strip())]
    output = RunOutput(as_json, quiet)
    with executor(workers, None) as chosen:
        found = tune_trackers(loaded, names, plan, chosen, output)
    for item in found:
        click.echo(f"{item.tracker}: {settings(item.best.values)} (start {settings(item.start or {})})")
        for measure in item.held_out.comparisons:
            values = f"{measure.start.value:.4g} -> {measure.tuned.value:.4g}"
            click.echo(f"  {measure.scenario} {measure.measure}: {values}, p {measure.p_value:.3g}: {measure.verdict}")
    best = {item.tracker: item.best.values for item in found}
    for scenario in loaded:
        file = out if len(loaded) == 1 else out / f"{scenario.config.name}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        results.write_text(file, written(scenario, best))

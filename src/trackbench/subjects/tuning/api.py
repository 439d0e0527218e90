"""The call ``trackbench.tune``, and the steps that it shares with the command."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from trackbench.api.plan import Counter, Listener
from trackbench.api.result import Report
from trackbench.api.run import Several
from trackbench.api.scenario import Named, listed, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.execution import Executor, executor
from trackbench.base.types import Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, require_engine
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.load import select_trackers
from trackbench.scenario.shipped import shown_name
from trackbench.scenario.truth import PendingTruths
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.files import default_out, require_tuning_files, save_tuning, tuning_content
from trackbench.subjects.tuning.held_out import Split, halved, halved_in_time
from trackbench.subjects.tuning.objectives import Objective, objective_of
from trackbench.subjects.tuning.parameters import (
    parse_range,
    require_tunable,
    start_values,
    usual_ranges,
)
from trackbench.subjects.tuning.report import tuning_document, tuning_summary
from trackbench.subjects.tuning.study import require_optuna, usual_trials
from trackbench.subjects.tuning.tune import Tuning, TuningTask, tune_tracker


@dataclass(frozen=True)
class TunePlan:
    """Settings of a tuning, such as ranges and numbers of trials, scenes and runs, common to all its trackers."""

    objective: Objective
    ranges: tuple[str, ...] = ()
    """Ranges as ``KEY=LOW:HIGH`` or ``KEY=A,B,C``; empty for the usual ranges."""
    trials: int | None = None
    seed: int = 0
    storage: Path | None = None
    split: Split = field(default_factory=Split)
    isolation: Isolation = ISOLATED
    engine: EngineName = "auto"

    def __post_init__(self) -> None:
        require_engine(self.engine)


def tune_trackers(
    scenarios: Sequence[Scenario], trackers: Iterable[str], plan: TunePlan, executor: Executor, listener: Listener
) -> list[Tuning]:
    """Tune each tracker by itself, with one set of values for all scenarios.

    Raises:
        InputError: a scenario, a range or the storage is invalid, or a tracker cannot be tuned.
        TrackbenchError: the processes that do the work died.
    """
    require_optuna()
    names = [item.config.name for item in scenarios]
    for item in scenarios:
        if names.count(item.config.name) > 1:
            raise InputError(f"another scenario has the name {item.config.name!r} too", file=item.path, key="name")
    tuned = list(dict.fromkeys(trackers))
    chosen = [select_trackers(item, tuned) for item in scenarios]
    for item in scenarios:
        for name in tuned:
            require_tunable(item, name)
    for item in chosen:
        check_plugins(item, plan.isolation)
    tasks = [_task(name, scenarios, plan) for name in tuned]
    halves = [halved(item, plan.split) for item in chosen]
    train = [_bench(item.train, executor, listener) for item in halves]
    benches = [
        halved_in_time(bench, plan.objective)
        if item.test is item.train
        else (bench, _bench(item.test, executor, listener), item.apart)
        for bench, item in zip(train, halves, strict=True)
    ]
    tunings = []
    for task in tasks:
        with listener.progress(task.tracker, "trials") as advance:
            tunings.append(tune_tracker(task, benches, executor, plan.isolation, plan.engine, advance))
    return tunings


def _task(name: str, scenarios: Sequence[Scenario], plan: TunePlan) -> TuningTask:
    """Return the task of one tracker; the first scenario sets its options, which all other scenarios must accept."""
    first = scenarios[0]
    parameters = [parse_range(text, first, name) for text in plan.ranges] or usual_ranges(first, name)
    keys = [item.key for item in parameters]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"two ranges of {key}; give one", key="--range")
    for other in scenarios[1:]:
        for item in parameters:
            parse_range(str(item), other, name)
    return TuningTask(
        tracker=name,
        objective=plan.objective,
        parameters=tuple(parameters),
        start=start_values(first, name, parameters),
        count=plan.trials or usual_trials(parameters),
        seed=plan.seed,
        storage=plan.storage,
    )


def _bench(loaded: Scenario, executor: Executor, listener: Listener) -> Bench:
    pending = PendingTruths(loaded, executor)
    with listener.progress(f"truth of {loaded.config.name}", "steps") as advance:
        return Bench(loaded, pending.collect(advance))


class TunedTrackers:
    """Tuned trackers. A notebook shows a page of them, ``print`` text; ``tuned["ekf_cv"]`` is one tracker's tuning."""

    def __init__(self, tunings: Sequence[Tuning], scenarios: Sequence[Scenario], command: str) -> None:
        self._tunings, self._scenarios, self._command = tunings, scenarios, command

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """Tuned values by tracker and option; option keys are relative to ``trackers.NAME`` in the scenario."""
        return {item.tracker: dict(item.best.values) for item in self._tunings}

    def json(self) -> dict[str, Any]:
        """Return all numbers as a dictionary, with the keys of ``trackbench tune --json``."""
        return tuning_content(self._tunings, self._command)

    def report(self) -> Report:
        """Return the report that ``trackbench tune`` writes."""
        return Report(tuning_document(self._tunings, self._command))

    def save(self, out: Path | str) -> list[str]:
        """Write the scenario with the tuned values, the report and the numbers; return the names of the files.

        Args:
            out: a file whose name ends in ``.yaml``; for several scenarios a folder.

        Raises:
            TrackbenchError: a file cannot be written.
        """
        path = Path(out)
        require_tuning_files(path, self._scenarios)
        return [str(file) for file in save_tuning(self._tunings, self._scenarios, path, self._command)]

    def __getitem__(self, tracker: str) -> Tuning:
        return next(item for item in self._tunings if item.tracker == tracker)

    def __repr__(self) -> str:
        return f"<tuning of {', '.join(item.tracker for item in self._tunings)}>"

    def __str__(self) -> str:
        return str(Report(tuning_summary(self._tunings)))

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def tune(
    scenario: Scenario | Named | Several,
    trackers: Iterable[str],
    *,
    ranges: Iterable[str] = (),
    objective: str | None = None,
    trials: int | None = None,
    storage: Path | str | None = None,
    train_scenes: int | None = None,
    test_scenes: int | None = None,
    train_runs: int | None = None,
    test_runs: int | None = None,
    seed: int = 0,
    workers: int = 1,
    engine: EngineName = "auto",
    progress: Progress = no_progress,
) -> TunedTrackers:
    """Find the best options of trackers on some scenes and noise, and test them on other scenes and noise.

    Args:
        scenario: a scenario, loaded or by its path or name; several get one set of values for all.
        trackers: names of the trackers to tune, each by itself.
        ranges: ranges such as ``"acceleration_sigma_mps2=0.1:30"`` or ``"initial.skip=0,2,5"``; empty for the usual
            ranges of the process noise and other main options.
        objective: ``likelihood``, ``position_rmse``, ``tgospa`` or a metric of the scenario; None for ``tgospa`` with
            hidden identities and a ground truth, else ``likelihood``.
        trials: number of sets of values to try; None for a number that grows with the options.
        storage: SQLite file that keeps the trials, so that an interrupted search goes on.
        train_scenes: number of scenes for tuning.
        test_scenes: number of scenes for the test.
        train_runs: number of runs of each tuning scene.
        test_runs: number of runs of each test scene.
        seed: seed of the search.
        workers: number of processes.
        engine: ``auto``, ``numpy`` or ``fused``.
        progress: called with a tracker's number of finished trials and of all trials.

    Raises:
        InputError: a scenario, a range or the storage is invalid, or Optuna is not installed.
        TrackbenchError: the processes that do the work died.
    """
    _require_numbers(2, trials=trials)
    _require_numbers(1, train_scenes=train_scenes, test_scenes=test_scenes, train_runs=train_runs, test_runs=test_runs)
    _require_numbers(0, seed=seed)
    loaded = [loaded_scenario(item) for item in (scenario if isinstance(scenario, list | tuple) else [scenario])]
    split = Split(train_scenes, test_scenes, train_runs, test_runs)
    path = None if storage is None else Path(storage)
    plan = TunePlan(objective_of(objective, loaded), tuple(listed(ranges)), trials, seed, path, split, engine=engine)
    names = listed(trackers)
    with executor(workers, None) as chosen:
        tunings = tune_trackers(loaded, names, plan, chosen, Counter(progress, "trials"))
    return TunedTrackers(tunings, loaded, command_of_tuning(loaded, names, plan, default_out(loaded)))


def _require_numbers(least: int, **options: Any) -> None:
    for name, value in options.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
            raise InputError(f"give a whole number, at least {least}, not {value!r}", key=name)


def command_of_tuning(scenarios: Sequence[Scenario], trackers: Sequence[str], plan: TunePlan, out: Path) -> str:
    """Return the shell command that repeats a tuning."""
    options = {
        "--objective": plan.objective.name,
        "--trials": plan.trials,
        **{f"--{name.replace('_', '-')}": value for name, value in asdict(plan.split).items()},
        "--seed": plan.seed or None,
        "--engine": None if plan.engine == "auto" else plan.engine,
        "--out": out,
    }
    texts = [part for name, value in options.items() if value is not None for part in (name, str(value))]
    ranges = [part for text in plan.ranges for part in ("--range", text)]
    changes = [part for text in scenarios[0].overrides for part in ("--set", text)]
    named = [shown_name(item.path) for item in scenarios]
    return shlex.join(["trackbench", "tune", *named, "--trackers", ",".join(trackers), *ranges, *changes, *texts])

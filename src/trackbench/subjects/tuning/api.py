"""Tuning the trackers of scenarios: what is behind ``trackbench tune``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

from trackbench.api.plan import Listener
from trackbench.base.errors import InputError, nearest
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, require_engine
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.load import select_trackers
from trackbench.scenario.truth import PendingTruths
from trackbench.subjects.tuning.evaluation import Bench
from trackbench.subjects.tuning.objectives import OBJECTIVES, Objective, metric_objectives
from trackbench.subjects.tuning.ranges import (
    has_option,
    parse_range,
    require_no_repetition,
    require_tunable,
    start_values,
    usual_ranges,
    why_no_start,
)
from trackbench.subjects.tuning.search import usual_trials
from trackbench.subjects.tuning.split import Split, halved
from trackbench.subjects.tuning.study import require_optuna
from trackbench.subjects.tuning.tune import Tuning, TuningTask, require_objective, tune, without_truth


@dataclass(frozen=True)
class TunePlan:
    """How trackers are tuned."""

    objective: Objective
    ranges: tuple[str, ...] = ()
    """``KEY=LOW:HIGH`` or ``KEY=A,B,C`` each; the usual ones unless given."""
    trials: int | None = None
    seed: int = 0
    storage: Path | None = None
    split: Split = field(default_factory=Split)
    isolation: Isolation = ISOLATED
    engine: EngineName = "auto"

    def __post_init__(self) -> None:
        require_engine(self.engine)


def objective_of(name: str | None, scenarios: Sequence[Scenario]) -> Objective:
    """The objective of a name; unless given, GOSPA where there is one, and else the likelihood."""
    if name is None:
        hidden = any(item.config.sensing.identities == "hidden" and not without_truth(item) for item in scenarios)
        name = "gospa" if hidden else "likelihood"
    known = {**metric_objectives(scenarios[0]), **OBJECTIVES} if scenarios else OBJECTIVES
    if name not in known:
        raise InputError(f"no objective {name!r}; {nearest(name, known)}", key="--objective")
    return known[name]


def tune_trackers(
    scenarios: Sequence[Scenario], trackers: Iterable[str], plan: TunePlan, executor: Executor, listener: Listener
) -> list[Tuning]:
    """Tune each of some trackers by itself, with one set of values for all scenarios.

    Raises:
        InputError: something is wrong in a scenario, a range or the storage, or a tracker cannot be tuned so.
        TrackbenchError: the processes that do the work died.
    """
    require_optuna()
    require_objective(plan.objective, scenarios)
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
    tasks = [_task(name, scenarios, tuned, plan) for name in tuned]
    halves = [halved(item, plan.split) for item in chosen]
    train = [_bench(item.train, executor, listener) for item in halves]
    test = [
        one if item.test is item.train else _bench(item.test, executor, listener)
        for one, item in zip(train, halves, strict=True)
    ]
    found = []
    for task in tasks:
        with listener.progress(task.tracker, "trials") as advance:
            apart = [item.apart for item in halves]
            found.append(tune(task, train, test, apart, executor, plan.isolation, plan.engine, advance))
    return found


def _task(name: str, scenarios: Sequence[Scenario], names: Sequence[str], plan: TunePlan) -> TuningTask:
    """What is tuned of one tracker; the first scenario says what its options are, and the others must take them."""
    first = scenarios[0]
    given = [text for text in plan.ranges if _is_for(text, first, name, names)]
    notes = [f"--range {text} is not for {name}, which lacks this option." for text in plan.ranges if text not in given]
    parameters = [parse_range(text, first, name) for text in given] or usual_ranges(first, name)
    require_no_repetition(parameters)
    for other in scenarios[1:]:
        for item in parameters:
            parse_range(str(item), other, name)
    trials = plan.trials or usual_trials(parameters, len(plan.objective.axes) > 1)
    start = start_values(first, name, parameters)
    notes += why_no_start(first, name, parameters)
    return TuningTask(
        name, plan.objective, tuple(parameters), start, trials, plan.seed, plan.storage, notes=tuple(notes)
    )


def _is_for(text: str, loaded: Scenario, name: str, names: Sequence[str]) -> bool:
    """Whether a range is for a tracker: it has the option, or none of those that are tuned has."""
    return has_option(loaded, name, text) or not any(has_option(loaded, other, text) for other in names)


def _bench(loaded: Scenario, executor: Executor, listener: Listener) -> Bench:
    pending = PendingTruths(loaded, executor)
    with listener.progress(f"truth of {loaded.config.name}", "steps") as advance:
        return Bench(loaded, pending.collect(advance))

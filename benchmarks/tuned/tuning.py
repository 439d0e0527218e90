"""The search for the values of each tracker, for each set of scenarios."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from trackbench.api.listener import Listener
from trackbench.api.tune import TunePlan, tune_trackers
from trackbench.execution import InProcess
from trackbench.tuning.objectives import OBJECTIVES
from trackbench.tuning.split import Split

from .protocol import Protocol

Values = dict[str, Any]


def tuned(protocol: Protocol, tracker: str, scenarios: list[str]) -> Values:
    """The best values of one tracker for some scenarios."""
    entry, ranges = protocol.trackers[tracker]["entry"], protocol.trackers[tracker]["ranges"]
    loaded = [protocol.loaded(name, {tracker: entry}) for name in scenarios]
    budget = protocol.tuned_on
    split = Split(budget.scenes, 1, budget.runs, 1)
    plan = TunePlan(OBJECTIVES[protocol.objective], tuple(ranges), protocol.trials, split=split)
    (found,) = tune_trackers(loaded, [tracker], plan, InProcess(), Listener())
    return dict(found.best.values)


def all_tuned(protocol: Protocol, pool: Executor) -> Iterator[tuple[str, str, Values]]:
    """Tracker, set of scenarios and values, the longest searches first."""
    pending = [
        (tracker, name, pool.submit(tuned, protocol, tracker, scenarios))
        for name, scenarios in sorted(protocol.sets().items(), key=lambda item: -len(item[1]))
        for tracker in protocol.trackers
    ]
    for tracker, name, future in pending:
        yield tracker, name, future.result()

"""The search for the values of each tracker, for each set of scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from trackbench.api.plan import Listener
from trackbench.base.execution import Executor as WorkExecutor
from trackbench.subjects.tuning.api import TunePlan, tune_trackers
from trackbench.subjects.tuning.held_out import Split
from trackbench.subjects.tuning.objectives import objective_of

from .protocol import Protocol


def tuned(protocol: Protocol, tracker: str, scenarios: Sequence[str], storage: Path | None) -> dict[str, Any]:
    """Return the best values of one tracker for some scenarios.

    Args:
        protocol: how it is tuned.
        tracker: its name.
        scenarios: their names.
        storage: keeps the trials, so that an interrupted search goes on.
    """
    stated, budget = protocol.trackers[tracker], protocol.tuned_on
    split = Split(budget.scenes, 1, budget.runs, 1)
    loaded = [protocol.loaded(name, {tracker: stated["entry"]}) for name in scenarios]
    objective, ranges = objective_of(protocol.objective, loaded), tuple(stated["ranges"])
    plan = TunePlan(objective, ranges, protocol.trials, 0, storage, split, engine="fused")
    (tuning,) = tune_trackers(loaded, [tracker], plan, WorkExecutor(), Listener())
    return dict(tuning.best.values)


def all_tuned(protocol: Protocol, pool: Executor, folder: Path | None) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield tracker, set of scenarios and values: of each scenario by itself, then of the families of several.

    Args:
        protocol: how trackers are tuned.
        pool: processes that search.
        folder: of the trials; None keeps none.
    """
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    several = {name: scenarios for name, scenarios in protocol.families.items() if len(scenarios) > 1}
    sets = {name: [name] for name in protocol.scenarios} | several
    pending = {
        (tracker, name): pool.submit(
            tuned, protocol, tracker, scenarios, None if folder is None else folder / f"{tracker}_{name}.db"
        )
        for tracker in protocol.trackers
        for name, scenarios in sets.items()
    }
    for (tracker, name), future in pending.items():
        yield tracker, name, future.result()

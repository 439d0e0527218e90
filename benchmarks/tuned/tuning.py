"""The search for the values of each tracker, for each set of scenarios."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from trackbench.base.execution import Executor as WorkExecutor
from trackbench.base.types import no_progress
from trackbench.scenario.truth import PendingTruths
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator, Outcome
from trackbench.subjects.tuning.held_out import Split, halved
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import OBJECTIVES
from trackbench.subjects.tuning.parameters import start_values
from trackbench.subjects.tuning.search import Proposals, search
from trackbench.subjects.tuning.study import Study, TuningTrial, best_trial, trial_of

from .protocol import Protocol

#: What came of a tracker's values in one scenario, by their JSON.
Outcomes = dict[str, Outcome]


class Tried:
    """A tracker in one scenario, on the scenes that it is tuned on; each set of values is tried once.

    Args:
        protocol: how.
        tracker: its name.
        scenario: its name.
        outcomes: of what was tried already.
    """

    def __init__(self, protocol: Protocol, tracker: str, scenario: str, outcomes: Outcomes) -> None:
        budget = protocol.tuned_on
        loaded = protocol.loaded(scenario, {tracker: protocol.entries[tracker]})
        self.parameters = protocol.parameters(tracker, loaded)
        self.start = start_values(loaded, tracker, self.parameters)
        self.outcomes = outcomes
        train = halved(loaded, Split(budget.scenes, 1, budget.runs, 1)).train
        bench = Bench(train, PendingTruths(train, WorkExecutor()).collect(no_progress))
        self._evaluator = Evaluator([bench], tracker, self.parameters, WorkExecutor(), engine="fused")

    @property
    def as_it_is(self) -> Sums | None:
        """What the tracker gives with the values that it starts from; None where it fails."""
        return self._evaluator.start[0].sums

    def __call__(self, points: Sequence[Values]) -> list[Outcome]:
        """What comes of each."""
        keys = [json.dumps(point) for point in points]
        missing = {key: point for key, point in zip(keys, points, strict=True) if key not in self.outcomes}
        outcomes = self._evaluator(list(missing.values())) if missing else []
        self.outcomes |= {key: outcome for key, (outcome,) in zip(missing, outcomes, strict=True)}
        return [self.outcomes[key] for key in keys]


def tuned(
    protocol: Protocol, tracker: str, scenarios: Sequence[str], outcomes: Sequence[Outcomes]
) -> tuple[dict[str, Any], list[Outcomes]]:
    """The best values of one tracker for some scenarios, and what came of all that were tried.

    The values that are spread over the ranges are the same in every search of a tracker.
    """
    tried = [Tried(protocol, tracker, *of) for of in zip(scenarios, outcomes, strict=True)]
    objective = OBJECTIVES[protocol.objective]
    start = [sums for item in tried if (sums := item.as_it_is) is not None]
    assert len(start) == len(tried), f"{tracker} fails as it is"

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        outcomes = zip(*(item(points) for item in tried), strict=True)
        return [trial_of(objective, point, of, start) for point, of in zip(points, outcomes, strict=True)]

    parameters = tried[0].parameters
    study = Study(tracker, None, parameters, objective.axes, {})
    search(parameters, study, tried[0].start, make, objective.losses, protocol.trials, 0, batches=batches(protocol))
    best = best_trial(study.trials)
    assert best is not None, f"every trial of {tracker} failed"
    return dict(best.values), [item.outcomes for item in tried]


def batches(protocol: Protocol) -> list[Proposals]:
    """Of each search."""
    local = protocol.around_the_best
    return [Proposals("spread", protocol.spread), *(Proposals("local", local.size, radius) for radius in local.radii)]


class Kept:
    """What came of each scenario's own search, in a folder if one is given: a search that was interrupted, or that has
    other families, does not try it again."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def of(self, tracker: str, scenario: str) -> Outcomes:
        """What was tried; nothing where nothing is kept."""
        file = self._file(tracker, scenario)
        return pickle.loads(file.read_bytes()) if file is not None and file.exists() else {}

    def keep(self, tracker: str, scenario: str, outcomes: Outcomes) -> None:
        """Keep it for another search."""
        file = self._file(tracker, scenario)
        if file is not None:
            file.write_bytes(pickle.dumps(outcomes))

    def _file(self, tracker: str, scenario: str) -> Path | None:
        return None if self._folder is None else self._folder / f"{tracker}_{scenario}.pickle"


def all_tuned(protocol: Protocol, pool: Executor, kept: Kept) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Tracker, set of scenarios and values: of each scenario by itself, then of the families of several."""
    alone = {
        (tracker, name): pool.submit(tuned, protocol, tracker, [name], [kept.of(tracker, name)])
        for tracker in protocol.trackers
        for name in protocol.scenarios
    }
    together: dict[tuple[str, str], Future[Any]] = {}
    for tracker in protocol.trackers:
        outcomes = {}
        for name in protocol.scenarios:
            best, (outcomes[name],) = alone.pop((tracker, name)).result()
            kept.keep(tracker, name, outcomes[name])
            yield tracker, name, best
        for name, scenarios in protocol.families.items():
            if len(scenarios) > 1:
                tried = [outcomes[item] for item in scenarios]
                together[tracker, name] = pool.submit(tuned, protocol, tracker, scenarios, tried)
    for (tracker, name), future in together.items():
        yield tracker, name, future.result()[0]

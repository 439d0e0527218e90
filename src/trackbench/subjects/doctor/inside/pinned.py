"""Each model of an interacting multiple model filter alone: the filter that it is while no other is probable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.inside.interaction import Bank, bank_of, models_of
from trackbench.subjects.doctor.inside.values import HeldAt, Way, formed, held_values
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import Tracker

#: Probability of the other models: no likelihood makes one of them count.
NEVER = 1e-30
#: Probability from which on a model is alone.
ALONE = 1.0 - 1e-9


class _Pinned:
    """A tracker with other transition probabilities, from when it has some."""

    def __init__(self, tracker: Any, path: Way, matrix: Array) -> None:
        self.within, self.batched = tracker, bool(getattr(tracker, "batched", False))
        self._path, self._matrix = path, matrix
        self._done = False
        self._put(None)

    def step(self, state: Any, scan: Scan) -> Any:
        answer = self.within.step(state, scan)
        if not self._done:
            self._put(answer[0])
        return answer

    def _put(self, state: Any) -> None:
        for entry in held_values((self.within, state)):
            if entry.path == self._path and entry.place is not None:
                _put(entry.place, self._matrix)
                self._done = True


class ModelAlone:
    """One model of a tracker: all its models turn into this one at every transition.

    Args:
        tracker: with all models.
        bank: the models.
        model: its number, from 0.
    """

    def __init__(self, tracker: TrackerUnderTest, bank: Bank, model: int) -> None:
        self._tracker, self._bank, self._model = tracker, bank, model
        self._matrix = np.full(bank.transition.shape, NEVER)
        self._matrix[:, model] = 1.0
        if not np.array_equal(bank.held.value, bank.transition):
            self._matrix = self._matrix.T
        self._under_test = tracker.of_another(self._make)

    @contextmanager
    def alone(self) -> Iterator[TrackerUnderTest]:
        """The model as a tracker, within the block: the transition probabilities may be a constant of its module."""
        # What a module holds has a way that begins with its name.
        place = self._bank.held.place if isinstance(self._bank.held.path[0], str) else None
        if place is None:
            yield self._under_test
            return
        before = place.get()
        try:
            _put(place, self._matrix)
            yield self._under_test
        finally:
            place.put(before)

    def _make(self) -> Tracker:
        return _Pinned(self._tracker.make(), self._bank.held.path, self._matrix)

    def succeeds(self) -> bool:
        """Whether the model has all the probability after some scans."""
        session = TrackerSession(self._make)
        scans = self._tracker.approach(self._tracker.probes.general[0], self._tracker.sensor_sets()[-1], 1.0)
        with self.alone():
            try:
                session.follow([*scans, empty_scan(scans[-1]._replace(time=scans[-1].time + 0.05))])
            except StepFailed:
                return False
        models = models_of(session, self._bank)
        return models is not None and bool(models.probability[self._model] > ALONE)


def models_alone(tracker: TrackerUnderTest) -> list[ModelAlone]:
    """The models of an interacting multiple model filter; none of another, or where one does not stay alone."""
    bank_steps = tracker.once(bank_of)
    if bank_steps is None:
        return []
    models = [ModelAlone(tracker, bank_steps[0], j) for j in range(len(bank_steps[0].transition))]
    return models if all(model.succeeds() for model in models) else []


def of_each_model(results: Sequence[PartResult]) -> PartResult:
    """The results of one check of each model, as one of the tracker: each says of which model it is."""
    merged = PartResult()
    names = dict.fromkeys(check.name for result in results for check in result.checks)
    for name in names:
        # A model that fails at all steps of a sensor has no answer with it.
        none = next(check for result in results for check in result.checks if check.name == name)
        none = replace(none, passed=None, result="there was no estimate", faults=())
        checks = [next((check for check in result.checks if check.name == name), none) for result in results]
        failed = [check.passed is False for check in checks]
        made = [check.passed is not None for check in checks]
        said = [f"model {j}: {check.result}" for j, check in enumerate(checks, 1) if any(failed) <= (not check.passed)]
        text = checks[0].result if not any(made) else "; ".join(said)
        faults = tuple(dict.fromkeys(fault for check in checks for fault in check.faults))
        passed = not any(failed) if any(made) else None
        merged.checks.append(replace(checks[0], passed=passed, result=text, faults=faults))
    merged.findings = [
        replace(finding, evidence=f"of model {j} alone: {finding.evidence}")
        for j, result in enumerate(results, 1)
        for finding in result.findings
    ]
    return merged


def _put(place: HeldAt, matrix: Array) -> None:
    """The matrix in the form of what is there."""
    place.put(formed(place.get(), matrix))

"""Single models of an interacting multiple model filter, each examined as a filter of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.inside.interaction import Bank, find_bank, models_of
from trackbench.subjects.doctor.inside.values import HeldAt, KeyPath, held_values, reshape
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import Tracker

#: Transition probability to other models, so small that no likelihood makes them count.
NEVER = 1e-30
#: Least probability of a model that counts as alone.
ALONE = 1.0 - 1e-9


class _Pinned:
    """A tracker whose transition probabilities are replaced by ``matrix`` as soon as it holds them."""

    def __init__(self, tracker: Any, path: KeyPath, matrix: Array) -> None:
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
                _put_matrix(entry.place, self._matrix)
                self._done = True


class SingleModel:
    """One model of a tracker, made the only one: its transition probability from every model becomes 1.

    Args:
        tracker: tracker with all models.
        bank: models of the tracker.
        model: index of the model.
    """

    def __init__(self, tracker: TrackerUnderTest, bank: Bank, model: int) -> None:
        self._tracker, self._bank, self._model = tracker, bank, model
        self._matrix = np.full(bank.transition.shape, NEVER)
        self._matrix[:, model] = 1.0
        if not np.array_equal(bank.held.value, bank.transition):
            self._matrix = self._matrix.T
        self._under_test = tracker.for_tracker(self._make)

    @contextmanager
    def as_tracker(self) -> Iterator[TrackerUnderTest]:
        """Yield the model as a tracker under test; meanwhile a transition matrix of its module is replaced."""
        # The path to a value of a module begins with a name.
        place = self._bank.held.place if isinstance(self._bank.held.path[0], str) else None
        if place is None:
            yield self._under_test
            return
        held = place.get()
        try:
            _put_matrix(place, self._matrix)
            yield self._under_test
        finally:
            place.put(held)

    def _make(self) -> Tracker:
        return _Pinned(self._tracker.make(), self._bank.held.path, self._matrix)

    def succeeds(self) -> bool:
        """Return whether the model can be made the only one: it has all the probability after 1 s of scans."""
        session = TrackerSession(self._make)
        scans = self._tracker.approach(self._tracker.probes.general[0], self._tracker.sensor_sets()[-1], 1.0)
        with self.as_tracker():
            try:
                session.follow([*scans, empty_scan(scans[-1]._replace(time=scans[-1].time + 0.05))])
            except StepFailed:
                return False
        models = models_of(session, self._bank)
        return models is not None and bool(models.probability[self._model] > ALONE)


def single_models(tracker: TrackerUnderTest) -> list[SingleModel]:
    """Return the models of an interacting multiple model filter; no models if any cannot be made the only one."""
    bank_steps = tracker.once(find_bank)
    if bank_steps is None:
        return []
    models = [SingleModel(tracker, bank_steps[0], j) for j in range(len(bank_steps[0].transition))]
    return models if all(model.succeeds() for model in models) else []


def merge_models(results: Sequence[PartResult]) -> PartResult:
    """Merge the results of one check, made with each model alone, into one whose texts name the models."""
    merged = PartResult()
    names = dict.fromkeys(check.name for result in results for check in result.checks)
    for name in names:
        # A model that fails at all steps of a sensor has no answer with it.
        no_answer = next(check for result in results for check in result.checks if check.name == name)
        no_answer = replace(no_answer, passed=None, result="there was no estimate", faults=())
        checks = [next((check for check in result.checks if check.name == name), no_answer) for result in results]
        failed = [check.passed is False for check in checks]
        made = [check.passed is not None for check in checks]
        shown = [(j, check) for j, check in enumerate(checks, 1) if any(failed) <= (not check.passed)]
        text = checks[0].result if not any(made) else "; ".join(f"model {j}: {check.result}" for j, check in shown)
        faults = tuple(dict.fromkeys(fault for check in checks for fault in check.faults))
        passed = not any(failed) if any(made) else None
        merged.checks.append(replace(checks[0], passed=passed, result=text, faults=faults))
    merged.findings = [
        replace(finding, evidence=f"of model {j} alone: {finding.evidence}")
        for j, result in enumerate(results, 1)
        for finding in result.findings
    ]
    return merged


def _put_matrix(place: HeldAt, matrix: Array) -> None:
    place.put(reshape(place.get(), matrix))

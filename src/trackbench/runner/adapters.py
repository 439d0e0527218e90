"""Any tracker as one that takes a whole batch, its answers checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench.trackers.answers import NOT_FINITE, TrackerFault, checked, unpack
from trackbench.trackers.base import Tracker
from trackbench.trackers.filtered import FilterTracker, TrackState
from trackbench.types import Estimate, Scan


class Direct:
    """A built-in tracker, whose answers have the right form by construction."""

    def __init__(self, tracker: FilterTracker) -> None:
        self._tracker = tracker
        self._state: TrackState | None = None

    def step(self, scan: Scan) -> Estimate:
        """The estimates of all lanes."""
        self._state, estimate = self._tracker.step(self._state, scan)
        return estimate


class Batched:
    """A tracker that takes all lanes at once."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self._state: Any = None

    def step(self, scan: Scan) -> Estimate | None:
        """The estimates of all lanes, or None while there is none at all."""
        self._state, answer = unpack(self._tracker.step(self._state, scan))
        return checked(answer, scan)


class Looped:
    """A tracker that knows one object: a fresh one for each lane, from the lane's first reading to its end."""

    def __init__(self, make: Callable[[], Tracker], lanes: int) -> None:
        self._trackers = [make() for _ in range(lanes)]
        self._states: list[Any] = [None] * lanes
        self._begun = [False] * lanes

    def step(self, scan: Scan) -> Estimate | None:
        """Step every lane that has had a reading. Lanes are ``(lanes,)``."""
        answers: list[Estimate | None] = []
        for lane, tracker in enumerate(self._trackers):
            self._begun[lane] = self._begun[lane] or bool(scan.valid[lane])
            if not self._begun[lane]:
                answers.append(None)
                continue
            own = scan._replace(reading=scan.reading[:, lane].copy(), valid=scan.valid[lane])
            self._states[lane], answer = unpack(tracker.step(self._states[lane], own))
            estimate = checked(answer, own)
            if estimate is not None and not np.isfinite(estimate.mean.sum() + estimate.covariance.sum()):
                raise LaneFault(TrackerFault(NOT_FINITE), lane)
            answers.append(estimate)
        return together(answers, len(scan.reading))


class LaneFault(Exception):
    """A fault of one lane."""

    def __init__(self, cause: Exception, lane: int) -> None:
        super().__init__(str(cause))
        self.cause = cause
        self.lane = lane


def together(answers: list[Estimate | None], size: int) -> Estimate | None:
    """One estimate with a lane axis from those of single lanes; NaN where there is none."""
    given = [answer for answer in answers if answer is not None]
    if not given:
        return None
    size = next((len(answer.innovation) for answer in given if answer.innovation is not None), size)
    lanes = len(answers)
    mean, covariance = np.full((4, lanes), np.nan), np.full((4, 4, lanes), np.nan)
    innovation, spread = np.full((size, lanes), np.nan), np.full((size, size, lanes), np.nan)
    repaired = np.zeros(lanes, dtype=bool)
    for lane, answer in enumerate(answers):
        if answer is None:
            continue
        mean[:, lane], covariance[:, :, lane] = answer.mean, answer.covariance
        repaired[lane] = bool(answer.repaired) if answer.repaired is not None else False
        if answer.innovation is not None and answer.innovation_covariance is not None:
            innovation[:, lane], spread[:, :, lane] = answer.innovation, answer.innovation_covariance
    if np.isnan(innovation).all():
        return Estimate(mean, covariance, repaired=repaired)
    return Estimate(mean, covariance, innovation=innovation, innovation_covariance=spread, repaired=repaired)

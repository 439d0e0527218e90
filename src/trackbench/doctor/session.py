"""A tracker that follows one target, and can be tried on a scan without being changed."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench.stepping.faults import fault_of
from trackbench.trackers.answers import TOO_LARGE, TrackerFault, shaped, unpack
from trackbench.trackers.base import Tracker
from trackbench.types import Estimate, Scan

#: An estimate or a standard deviation beyond this is one of no target, m and m/s.
LARGEST = 1e9


class StepFailed(Exception):
    """A tracker raised, or what it returned is no estimate."""

    def __init__(self, error: BaseException, scan: Scan) -> None:
        self.fault = fault_of(error)
        super().__init__(self.fault.cause)
        self.scan = scan


class TrackerSession:
    """A fresh tracker that follows one target; scans and estimates have no batch axes.

    ``peek`` steps a copy of the tracker and of its state, because some trackers keep their state in the instance.
    """

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._tracker = make()
        self._batched = bool(getattr(self._tracker, "batched", False))
        self._state: Any = None
        self._started = False
        self.time: float | None = None
        """Of the last scan, s."""

    def step(self, scan: Scan) -> Estimate | None:
        """The estimate after a scan; None before the track has started.

        Raises:
            StepFailed: the tracker raised, or returned no valid estimate.
        """
        estimate, self._state = self._step(self._tracker, self._state, scan)
        self._started = self._started or estimate is not None
        self.time = scan.time
        return estimate

    def peek(self, scan: Scan) -> Estimate | None:
        """What ``step`` would return, without changing the session."""
        try:
            tracker, state = copy.deepcopy((self._tracker, self._state))
        except Exception as error:
            raise StepFailed(error, scan) from error
        return self._step(tracker, state, scan)[0]

    def copy(self) -> TrackerSession:
        """An independent session with the same state."""
        return copy.deepcopy(self)

    def _step(self, tracker: Tracker, state: Any, scan: Scan) -> tuple[Estimate | None, Any]:
        given = _batch_of_one(scan) if self._batched else scan
        try:
            state, returned = unpack(tracker.step(state, given))
            estimate = shaped(returned, given)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise StepFailed(error, scan) from error
        if estimate is not None and _too_large(estimate):
            raise StepFailed(TrackerFault(TOO_LARGE), scan)
        if estimate is None or not self._batched:
            return estimate, state
        # A batched tracker returns NaN for a track that has not started.
        if not self._started and np.isnan(estimate.mean).all():
            return None, state
        own = None if estimate.state is None else estimate.state[..., 0]
        return Estimate(estimate.mean[..., 0], estimate.covariance[..., 0], own), state


def _too_large(estimate: Estimate) -> bool:
    """Whether it is finite, and no target of a probe can be so far or so little known."""
    largest = max(
        float(np.abs(part).max(initial=0.0)) for part in (estimate.mean, np.sqrt(np.abs(estimate.covariance)))
    )
    return LARGEST < largest < np.inf


def finite(estimate: Estimate) -> bool:
    """Whether mean and covariance are finite."""
    return bool(np.isfinite(estimate.mean).all() and np.isfinite(estimate.covariance).all())


def _batch_of_one(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement[:, None], valid=scan.valid[None])

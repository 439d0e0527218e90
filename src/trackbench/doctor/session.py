"""One target followed by a tracker, which can be asked what it would say without being told."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from trackbench.trackers.answers import shaped, unpack
from trackbench.trackers.base import Tracker
from trackbench.types import Array, Scan


class Answer(NamedTuple):
    """What a tracker says of one target."""

    mean: Array
    """``(4,)``"""
    covariance: Array
    """``(4, 4)``"""
    innovation: Array | None = None
    """``(m,)``, from a tracker that gives it."""
    innovation_covariance: Array | None = None
    """``(m, m)``, likewise."""
    state: Array | None = None
    """``(n,)`` the tracker's own state, likewise."""

    @property
    def finite(self) -> bool:
        """Whether every number of mean and covariance is one."""
        return bool(np.isfinite(self.mean).all() and np.isfinite(self.covariance).all())


class Broken(Exception):
    """A tracker raised, or what it gave is no estimate."""

    def __init__(self, cause: BaseException, scan: Scan) -> None:
        super().__init__(str(cause))
        self.cause = cause
        self.scan = scan


class Session:
    """A tracker at work on one target.

    ``peek`` works on a copy of the tracker and of its state, so that it also leaves alone a tracker that keeps what it
    knows in itself.
    """

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._tracker = make()
        self._batched = bool(getattr(self._tracker, "batched", False))
        self._state: Any = None
        self._known = False

    def step(self, scan: Scan) -> Answer | None:
        """The estimate after a scan of no batch axes; None while there is none.

        Raises:
            Broken: the tracker cannot give one.
        """
        answer, self._state = self._ask(self._tracker, self._state, scan)
        self._known = self._known or answer is not None
        return answer

    def peek(self, scan: Scan) -> Answer | None:
        """What ``step`` would give; nothing is changed."""
        tracker, state = copy.deepcopy((self._tracker, self._state))
        return self._ask(tracker, state, scan)[0]

    def ahead(self) -> Session:
        """A copy that can go on by itself."""
        return copy.deepcopy(self)

    def _ask(self, tracker: Tracker, state: Any, scan: Scan) -> tuple[Answer | None, Any]:
        given = _batch_of_one(scan) if self._batched else scan
        try:
            after, said = unpack(tracker.step(state, given))
            estimate = shaped(said, given)
        except (Exception, SystemExit) as error:
            raise Broken(error, scan) from error
        if estimate is None:
            return None, after
        innovation = (estimate.innovation, estimate.innovation_covariance)
        spoken = Answer(estimate.mean, estimate.covariance, *innovation, estimate.state)
        if self._batched:
            # A batched tracker has NaN for a target of which it knows nothing yet.
            if not self._known and np.isnan(spoken.mean).all():
                return None, after
            first = [None if part is None else part[..., 0] for part in spoken[2:]]
            spoken = Answer(spoken.mean[..., 0], spoken.covariance[..., 0], *first)
        return spoken, after


def _batch_of_one(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement[:, None], valid=scan.valid[None])


def blind(scan: Scan) -> Scan:
    """The same instant without a measurement: what is then said is the prediction."""
    return scan._replace(measurement=np.full_like(scan.measurement, np.nan), valid=np.zeros_like(scan.valid))

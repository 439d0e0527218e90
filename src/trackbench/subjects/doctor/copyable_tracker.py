"""A tracker with its state, and copies of it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Estimate, Scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.trackers.answers import Tracker, shaped_estimate, unpack

#: Time from the last scan to that by which copies are tried, s.
TRIED = 0.05
SHARED = "its copies share its state"
#: How the message of `CannotCopy` begins.
NOT_COPIED = "it cannot be copied"


class CannotCopy(TrackbenchError):
    """A tracker that ``copy.deepcopy`` cannot copy, and that does not repeat its answers."""


class CopyableTracker:
    """A tracker with its state; its answers have the right shapes and are not checked further.

    A copy is made by ``copy.deepcopy``. Where that fails (an open file, a module, a lock, a generator), or the copy
    shares its state with the original (a handle of C code), it is a fresh tracker that is given the same scans again.

    Args:
        make: gives a fresh tracker.
    """

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._make = make
        self.tracker: Any = make()
        self.state: Any = None
        self.given: list[Scan] = []
        """The scans so far."""
        self.latest: Estimate | None = None
        """The estimate after the last scan."""
        self.not_copied: str | None = None
        """Why ``copy.deepcopy`` does not copy the tracker; None while it has not failed."""
        self._is_tried = False

    @property
    def batched(self) -> bool:
        """Whether the tracker says that it takes a batch at once."""
        return bool(getattr(self.tracker, "batched", False))

    def step(self, scan: Scan) -> Estimate | None:
        """Return the estimate after a scan.

        Raises:
            TrackerFault: the tracker returned no estimate.
        """
        self.state, answer = unpack(self.tracker.step(self.state, scan))
        self.latest = shaped_estimate(answer, scan)
        self.given.append(scan)
        return self.latest

    def copy(self) -> CopyableTracker:
        """Return an independent tracker with the same state.

        Raises:
            CannotCopy: the tracker can neither be copied nor repeated.
            TrackFault: its process has ended.
        """
        if self.not_copied is None:
            try:
                if self.given and not self._is_tried:
                    self._is_tried = True
                    self._require_own_state()
                if self.not_copied is None:
                    return self._twin()
            except TrackFault:
                raise
            except Exception as error:
                self.not_copied = fault_of(error).cause
        return self._repeated()

    def _twin(self) -> CopyableTracker:
        if hasattr(self.tracker, "__del__") and not hasattr(self.tracker, "__deepcopy__"):
            raise TrackbenchError("it has a destructor, which the end of a copy would call")
        twin = copy.copy(self)
        twin.tracker, twin.state = copy.deepcopy((self.tracker, self.state))
        twin.given = list(self.given)
        return twin

    def _require_own_state(self) -> None:
        """Step one copy, then another: if they differ, the first may have moved this one too. It is repeated then, as
        only a tracker that draws no random numbers can be."""
        last = self.given[-1]
        tried = last._replace(time=last.time + TRIED)
        one, other = self._twin(), self._twin()
        with suppress(Exception):
            if _gap(one.step(tried), other.step(tried)) > 0.0:
                again = self._repeated()
                self.tracker, self.state, self.not_copied = again.tracker, again.state, SHARED

    def _repeated(self) -> CopyableTracker:
        twin = CopyableTracker(self._make)
        twin.not_copied = self.not_copied
        problem = f"{NOT_COPIED} ({self.not_copied}), and a fresh one that is given the same {len(self.given)} scans"
        try:
            for scan in self.given:
                twin.step(scan)
        except Exception as error:
            raise CannotCopy(f"{problem} raises {fault_of(error).cause}") from error
        gap = _gap(self.latest, twin.latest)
        if gap > 0.0:
            raise CannotCopy(f"{problem} differs by up to {gap:.3g} m or m/s")
        return twin


def _gap(estimate: Estimate | None, other: Estimate | None) -> float:
    """Largest difference of two means; infinite where only one of them is there, or one is not finite."""
    if estimate is None or other is None:
        return 0.0 if estimate is other else np.inf
    if np.array_equal(estimate.mean, other.mean, equal_nan=True):
        return 0.0
    gap = float(np.abs(estimate.mean - other.mean).max())
    return gap if np.isfinite(gap) else np.inf

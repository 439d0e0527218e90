"""A tracker together with its state, and independent copies of both."""

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

#: Time from the last scan to the one with which copies are tried, s.
COPY_TRIAL_S = 0.05
SHARED = "its copies share its state"
#: Beginning of the message of `CannotCopy`.
NOT_COPIED = "it cannot be copied"


class CannotCopy(TrackbenchError):
    """Error of a tracker that ``copy.deepcopy`` cannot copy, and whose answers differ when scans are repeated."""


class CopyableTracker:
    """A tracker with its state, which can be copied; only the shapes of its answers are checked.

    A copy is made by ``copy.deepcopy``, which fails with an open file, a module, a lock or a generator, and shares the
    state of C code behind a handle. The copy is then a fresh tracker that is given the same scans again.

    Args:
        make: makes a fresh tracker.
    """

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self._make = make
        self.tracker: Any = make()
        self.state: Any = None
        self.scans: list[Scan] = []
        self.latest: Estimate | None = None
        """The estimate after the last scan."""
        self.not_copied: str | None = None
        """Reason why ``copy.deepcopy`` does not copy the tracker; None while it has not failed."""
        self._is_tried = False

    @property
    def batched(self) -> bool:
        return bool(getattr(self.tracker, "batched", False))

    def step(self, scan: Scan) -> Estimate | None:
        """Return the estimate after a scan; None if the tracker gives none.

        Raises:
            TrackerFault: the tracker's answer does not have the form or the shapes that it must have.
        """
        self.state, answer = unpack(self.tracker.step(self.state, scan))
        self.latest = shaped_estimate(answer, scan)
        self.scans.append(scan)
        return self.latest

    def copy(self) -> CopyableTracker:
        """Return an independent tracker with the same state.

        Raises:
            CannotCopy: the tracker can neither be copied nor repeated.
            TrackFault: the tracker's process has ended.
        """
        if self.not_copied is None:
            try:
                if self.scans and not self._is_tried:
                    self._is_tried = True
                    self._require_own_state()
                if self.not_copied is None:
                    return self._twin()
            except TrackFault:
                raise
            except Exception as error:
                self.not_copied = fault_of(error).cause
        return self._repeat()

    def _twin(self) -> CopyableTracker:
        if hasattr(self.tracker, "__del__") and not hasattr(self.tracker, "__deepcopy__"):
            raise TrackbenchError("it has a destructor, which the end of a copy would call")
        twin = copy.copy(self)
        twin.tracker, twin.state = copy.deepcopy((self.tracker, self.state))
        twin.scans = list(self.scans)
        return twin

    def _require_own_state(self) -> None:
        """Replace the tracker by a fresh one, given all scans again, if copies differ and so may share its state.

        Only a tracker that draws no random numbers can be repeated.
        """
        last = self.scans[-1]
        scan = last._replace(time=last.time + COPY_TRIAL_S)
        first, second = self._twin(), self._twin()
        with suppress(Exception):
            if _gap(first.step(scan), second.step(scan)) > 0.0:
                repetition = self._repeat()
                self.tracker, self.state, self.not_copied = repetition.tracker, repetition.state, SHARED

    def _repeat(self) -> CopyableTracker:
        twin = CopyableTracker(self._make)
        twin.not_copied = self.not_copied
        problem = f"{NOT_COPIED} ({self.not_copied}), and a fresh one that is given the same {len(self.scans)} scans"
        try:
            for scan in self.scans:
                twin.step(scan)
        except Exception as error:
            raise CannotCopy(f"{problem} raises {fault_of(error).cause}") from error
        gap = _gap(self.latest, twin.latest)
        if gap > 0.0:
            raise CannotCopy(f"{problem} differs by up to {gap:.3g} m or m/s")
        return twin


def _gap(estimate: Estimate | None, other: Estimate | None) -> float:
    """Return the largest difference of two estimated means; infinite if only one exists, or one is not finite."""
    if estimate is None or other is None:
        return 0.0 if estimate is other else np.inf
    if np.array_equal(estimate.mean, other.mean, equal_nan=True):
        return 0.0
    gap = float(np.abs(estimate.mean - other.mean).max())
    return gap if np.isfinite(gap) else np.inf

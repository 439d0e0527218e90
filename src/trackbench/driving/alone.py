"""A tracker as it is, and copies of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Estimate, Scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Stateful
from trackbench.trackers.answers import Tracker, shaped_estimate

#: Time from the last scan to that by which copies are tried, s.
TRIED = 0.05
SHARED = "its copies share its state"
#: How the message of `CannotCopy` begins.
NOT_COPIED = "it cannot be copied"


class CannotCopy(TrackbenchError):
    """A tracker that ``copy.deepcopy`` cannot copy, and that does not repeat its answers."""


class Alone(Stateful[Estimate | None]):
    """A tracker as it is, with its state: its answers have the right shapes and are not checked further.

    A copy is made by ``copy.deepcopy``. Where that fails (an open file, a module, a lock, a generator), or the copy
    shares its state with the original (a handle of C code), it is a fresh tracker that is given the same scans again.

    Args:
        make: gives a fresh tracker.
    """

    def __init__(self, make: Callable[[], Tracker]) -> None:
        super().__init__(make(), shaped_estimate)
        self._make = make
        self.given: list[Scan] = []
        """The scans so far."""
        self.not_copied: str | None = None
        """Why ``copy.deepcopy`` does not copy it; None while it has not failed."""
        self._latest: Estimate | None = None
        self._apart = False
        """Whether it was tried if its copies have a state of their own."""

    @property
    def latest(self) -> Estimate | None:
        """The estimate after the last scan."""
        return self._latest

    def step(self, scan: Scan, *more: Any) -> Estimate | None:
        """The estimate after a scan."""
        self._latest = super().step(scan, *more)
        self.given.append(scan)
        return self._latest

    def copy(self) -> Alone:
        """An independent one with the same state.

        Raises:
            CannotCopy: it can neither be copied nor repeated.
            TrackFault: its process has ended.
        """
        if self.not_copied is None:
            try:
                if self.given and not self._apart:
                    self._apart = True
                    self._try_apart()
                if self.not_copied is None:
                    return self._twin()
            except TrackFault:
                raise
            except Exception as error:
                self.not_copied = fault_of(error).cause
        return self._repeated()

    def _twin(self) -> Alone:
        twin = self.copied()
        twin.given = list(self.given)
        return twin

    def _try_apart(self) -> None:
        """Step one copy, then another: if they differ, the first may have moved this one too. It is repeated then, as
        only a tracker that draws no random numbers can be."""
        last = self.given[-1]
        tried = last._replace(time=last.time + TRIED)
        one, other = self._twin(), self._twin()
        with suppress(Exception):
            if _gap(one.step(tried), other.step(tried)) > 0.0:
                again = self._repeated()
                self.tracker, self.state, self.not_copied = again.tracker, again.state, SHARED

    def _repeated(self) -> Alone:
        twin = Alone(self._make)
        twin.not_copied = self.not_copied
        try:
            for scan in self.given:
                twin.step(scan)
        except Exception as error:
            raise self._cannot(f"raises {fault_of(error).cause}") from error
        gap = _gap(self._latest, twin._latest)
        if gap > 0.0:
            raise self._cannot(f"differs by up to {gap:.3g} m or m/s")
        return twin

    def _cannot(self, instead: str) -> CannotCopy:
        text = f"{NOT_COPIED} ({self.not_copied}), and a fresh one that is given the same {len(self.given)} scans "
        return CannotCopy(text + instead)


def _gap(estimate: Estimate | None, other: Estimate | None) -> float:
    """Largest difference of two means; infinite where only one of them is there, or one is not finite."""
    if estimate is None or other is None:
        return 0.0 if estimate is other else np.inf
    if np.array_equal(estimate.mean, other.mean, equal_nan=True):
        return 0.0
    gap = float(np.abs(estimate.mean - other.mean).max())
    return gap if np.isfinite(gap) else np.inf

"""How many steps an examination has asked of its tracker, and how many there will be about."""

from __future__ import annotations

import time
from collections.abc import Sequence

from trackbench.base.types import Progress
from trackbench.subjects.doctor.drives import TestDrive

#: Steps of all other checks over those of the drives, of an EKF. More where answers are averaged over samples.
OTHERS = 0.6
#: Time between two reports, s.
REPORTED = 0.2


class StepCount:
    """Called at every step.

    Args:
        progress: told of the number of steps done and of all steps.
        expected: how many steps there will be about.
    """

    def __init__(self, progress: Progress, expected: int) -> None:
        self._progress, self._expected = progress, expected
        self._done, self._reported = 0, 0.0
        progress(0, expected)

    def __call__(self) -> None:
        self._done += 1
        now = time.monotonic()
        if now - self._reported >= REPORTED:
            self._reported = now
            self._progress(self._done, max(self._expected, self._done))

    def left(self, steps: int) -> None:
        """Correct the number of steps by how many are left."""
        self._expected = self._done + steps
        self._progress(self._done, self._expected)


def steps_of(drives: Sequence[TestDrive], *, batched: bool) -> int:
    """Steps of a tracker in drives: one for each scan, and for each run unless it takes all runs at once."""
    return sum(1 if batched else scan.valid.size for drive in drives for scan in drive.scans)


def evidence_steps(drives: Sequence[TestDrive]) -> int:
    """Steps of a tracker in one run of drives, with the differences for the innovation of each measurement."""
    return sum(3 + 2 * len(scan.measurement) for drive in drives for scan in drive.scans)

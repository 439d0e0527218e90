"""One tracker's way through the measurements of a block of runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from typing import Generic

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Gaussian
from trackbench.driving.again import AskedAgain
from trackbench.driving.drive import Answer, DriveStep, TrackerDrive
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.engine.equations import EngineUsed
from trackbench.results import Failure
from trackbench.runner.run_spread import spread_in
from trackbench.runner.start import SecondDrives
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.config import FilterConfig


class TrackerRun(ABC, Generic[Answer]):
    """Takes the tracker from instant to instant, and notes why it cannot go on.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        name: of the tracker.
        drive: takes it through the scans of the block.
        time: ``(instants,)`` s.
        second_drives: gives the second drive of a plug-in, if the block is the one that has them.
    """

    def __init__(
        self,
        work: Work,
        piece: BlockRuns,
        name: str,
        drive: TrackerDrive[Answer],
        time: Array,
        second_drives: SecondDrives | None,
    ) -> None:
        self.name = name
        self.failure: Failure | None = None
        self.engine: EngineUsed | None = None
        """Known once it is closed, of a built-in tracker."""
        self.random = False
        """Whether it says that it draws random numbers; known once it is started."""
        self._work, self._piece, self._drive, self._time = work, piece, drive, time
        self._second_drives = second_drives
        self._again: AskedAgain | None = None
        self.spread = None if isinstance(work.trackers[name], FilterConfig) else spread_in(work, piece.scene)
        """How much its positions differ between runs; None of a built-in filter."""
        self._instants = self._through()

    @property
    @abstractmethod
    def chunk(self) -> int:
        """Number of instants after which it is scored."""

    def advance(self) -> Gaussian | None:
        """Take the tracker through the next instant, unless it has failed.

        Returns:
            Its estimate of the recorded run; None where that is in another block, or identities are hidden.
        """
        if self.failure is not None:
            return None
        return next(self._instants, None)

    def end(self) -> None:
        """End the tracker; where nothing was wrong with it, ask it again and note what differs."""
        self._instants.close()
        again, self._again = self._again, None
        disagreement = None if again is None or self.failure is not None else again.disagreement()
        if disagreement is not None:
            fault, scan = disagreement
            self.fail(fault, int(np.searchsorted(self._time, scan.time - SAME_TIME)), scan.sensor)

    def fail(self, fault: TrackFault, instant: int, sensor: str | None) -> None:
        """Note that and where the tracker cannot go on."""
        object, run = self._place(fault.member)
        where = {"step": instant, "time_s": float(self._time[instant]), "sensor": sensor, "object": object}
        self.failure = self._work.failure(self._piece, fault, run, **where)

    @abstractmethod
    def _take(self, step: DriveStep[Answer]) -> Gaussian | None:
        """Keep and score what the tracker says; after the last step of an instant return what ``advance`` does."""

    @abstractmethod
    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        """The object, and the run counted from the first of the block, of a member of the batch."""

    def _explained(self, fault: TrackFault) -> TrackFault:
        return fault

    def _through(self) -> Generator[Gaussian | None]:
        drive = self._drive
        try:
            with drive:
                self.random = drive.traits.random
                if self._second_drives is not None and drive.stepper is not None:
                    self._again = self._second_drives.around(self._work.driven(self.name), drive.stepper)
                    drive.stepper = self._again or drive.stepper
                for step in drive:
                    estimate = self._take(step)
                    if step.last:
                        yield estimate
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            self.fail(self._explained(fault_of(error)), drive.instant, drive.sensor)
        finally:
            self.engine = self._work.engine_of(drive.engine_used)

"""One tracker's way through the measurements of a block of runs: what it is given, and what is kept of its answers."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from types import TracebackType
from typing import Any, Generic, Self

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Scan
from trackbench.driving.again import AskedAgain
from trackbench.driving.drive import Answer, Delivery, DriveStep, deliveries
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Direct, DirectTracks, Offline, Stepper
from trackbench.engine.choice import seconds_on_kernels
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.protocol import Fault
from trackbench.results import Failure
from trackbench.runner.run_spread import spread_in
from trackbench.runner.start import SecondDrives
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.config import FilterConfig


class TrackerRun(ABC, Generic[Answer]):
    """A tracker of a block of runs.

    It is a context: inside, iterating gives the arguments of each step beside the state, and ``take`` gets the answer.
    What the tracker raises ends the context, and is kept as ``failure``; what a metric raises is passed on.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        name: of the tracker.
        time: ``(instants,)`` s.
        scans: in the order in which they were taken.
        second_drives: gives the second drive of a plug-in, if the block is the one that has them.
    """

    def __init__(
        self,
        work: Work,
        piece: BlockRuns,
        name: str,
        time: Array,
        scans: Sequence[Scan],
        second_drives: SecondDrives | None,
    ) -> None:
        self.name = name
        self.tracker: Any = None
        """Has ``step(state, *arguments) -> (state, answer)``; inside the context."""
        self.state: Any = None
        """Of the tracker; None before the first step."""
        self.scorer: Any = None
        """Has ``take(step)`` and ``close()``."""
        self.failure: Failure | None = None
        self.engine: EngineUsed | None = None
        """Known once the context is left, of a built-in tracker."""
        self.random = False
        """Whether it says that it draws random numbers; known once it is started."""
        self.spread = None if isinstance(work.trackers[name], FilterConfig) else spread_in(work, piece.scene)
        """How much its positions differ between runs; None of a built-in filter."""
        self._work, self._piece, self._time, self._scans = work, piece, time, scans
        self._second_drives = second_drives
        self._stepper: Stepper | None = None
        self._delivery: tuple[int, Delivery, bool] | None = None
        self._began = 0.0
        self._of_metric: Exception | None = None

    @property
    def instants(self) -> int:
        """Number of instants at which it is scored."""
        return len(self._time)

    @property
    def done(self) -> float:
        """Share of the instants that it has been taken to."""
        return 0.0 if self._delivery is None else (self._delivery[0] + 1) / max(self.instants, 1)

    def __enter__(self) -> Self:
        try:
            self._stepper = stepper = self._start()
            if self._second_drives is not None:
                self._stepper = stepper = self._second_drives.around(self._work.driven(self.name), stepper)
            # A built-in tracker is stepped as it is.
            self.tracker = stepper.tracker if isinstance(stepper, Direct | DirectTracks) else _Foreign(stepper)
            self.random = stepper.traits.random
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._note(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if self._stepper is not None:
            self.engine = self._work.engine_of(self._stepper.engine_used)
            self._stepper.close()
        passed_on = isinstance(error, KeyboardInterrupt) or (error is not None and error is self._of_metric)
        if error is not None and not passed_on:
            self._note(error)
        if isinstance(self._stepper, AskedAgain) and self.failure is None and not passed_on:
            disagreement = self._stepper.disagreement()
            if disagreement is not None:
                fault, scan = disagreement
                self.fail(fault, int(np.searchsorted(self._time, scan.time - SAME_TIME)), scan.sensor)
        return not passed_on

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        taken = 0
        for instant, group in enumerate(self._deliveries):
            if instant >= taken and self.failure is None:
                taken = instant + self._taken_at_once(instant)
            if instant < taken:
                continue
            for place, delivery in enumerate(group):
                if self.failure is not None:
                    return
                self._delivery = instant, delivery, place == len(group) - 1
                arguments = self._arguments(delivery)
                self._began = time.perf_counter() - seconds_on_kernels(self._work.engine_here)
                yield arguments

    def take(self, answer: Answer) -> None:
        """Keep and score what the tracker says to the latest arguments."""
        assert self._delivery is not None
        seconds = time.perf_counter() - seconds_on_kernels(self._work.engine_here) - self._began
        instant, delivery, last = self._delivery
        seconds = math.nan if isinstance(self._stepper, Offline) else seconds
        step = DriveStep(instant, *delivery, answer, seconds, last)
        try:
            self._score(step)
        except Fault as fault:
            self.fail(TrackFault(fault.cause, "answer", member=fault.member), fault.instant, None)
        except Exception as error:
            self._of_metric = error
            raise
        self._take(step)

    def fail(self, fault: TrackFault, instant: int, sensor: str | None) -> None:
        """Note that and where the tracker cannot go on."""
        object, run = self._place(fault.member)
        where = {"step": instant, "time_s": float(self._time[instant]), "sensor": sensor, "object": object}
        self.failure = self._work.failure(self._piece, fault, run, **where)

    @cached_property
    def _deliveries(self) -> list[list[Delivery]]:
        """What it is given at each instant."""
        offline = isinstance(self._stepper, Offline)
        scans = [scan.prompt() for scan in self._scans] if offline else self._scans
        config = self._work.trackers[self.name]
        return list(deliveries(scans, config.sensors_used, self._work.scenes[self._piece.scene].each_measurement))

    def _arguments(self, delivery: Delivery) -> tuple[Any, ...]:
        """What a step is given beside the state."""
        return (delivery.scan,)

    def _taken_at_once(self, instant: int) -> int:
        """Take the tracker through the instants from this one on without steps; return how many these are."""
        return 0

    def _note(self, error: BaseException) -> None:
        instant, sensor = (0, None) if self._delivery is None else (self._delivery[0], self._delivery[1].scan.sensor)
        self.fail(self._explained(fault_of(error)), instant, sensor)

    @abstractmethod
    def _start(self) -> Stepper:
        """A fresh tracker."""

    def _score(self, step: DriveStep[Answer]) -> None:
        """Have the scorer take in what the tracker says."""
        self.scorer.take(step)

    @abstractmethod
    def _take(self, step: DriveStep[Answer]) -> None:
        """Keep what the recorded run and the spread over runs have of what the tracker says."""

    @abstractmethod
    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        """The object, and the run counted from the first of the block, of a member of the batch."""

    def _explained(self, fault: TrackFault) -> TrackFault:
        return fault


class _Foreign:
    """A tracker that keeps its own state."""

    wants_origins = True

    def __init__(self, stepper: Stepper) -> None:
        self._stepper = stepper

    def step(self, _: None, scan: Scan, origins: Indices | None = None) -> tuple[None, Any]:
        return None, self._stepper.step(scan, origins)

"""Drive of one tracker through the measurements of a batch: arguments of its steps, scoring of its answers."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import cached_property, partial
from types import TracebackType
from typing import Any, Self

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import SAME_TIME, Indices, Scan
from trackbench.driving.cross_check import CrossCheckedTracker
from trackbench.driving.drive import Delivery, deliveries
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.isolation import plugged_in
from trackbench.driving.start import start_stepper
from trackbench.driving.steppers import ForeignTracker, Offline
from trackbench.engine.choice import seconds_on_kernels
from trackbench.engine.equations import EngineUsed
from trackbench.engine.machine import unavailable
from trackbench.metrics.protocol import Fault
from trackbench.results import Failure
from trackbench.runner.batches import Batch
from trackbench.runner.recorded import OnRecordedRun, Outcome
from trackbench.runner.scored_estimates import EstimateScoring
from trackbench.runner.work import Work
from trackbench.trackers.answers import is_random
from trackbench.trackers.filtered import FilterTracker

#: Largest number of instants in one sequence of kernel calls.
INSTANTS = 64
#: Number of runs of the second drive of a tracker that is not batched.
RUNS = 2


class TrackerRun:
    """Drive of one tracker through the runs of a batch: its steps, and the scoring of its answers.

    Inside its context, iteration yields the arguments of each step beside the state, and ``take`` scores the answer.
    An error of the tracker ends the context and is kept as ``failure``; an error of a metric is raised. External tracks
    take no steps, and are scored at the end.

    Args:
        work: data shared by all blocks.
        batch: runs with their measurements.
        name: name of the tracker.
        twice: whether a plug-in is driven through some runs a second time, to check it.
        observe: called at each instant with the estimates of the recorded run (kept for plots), if it is in the batch.
    """

    def __init__(self, work: Work, batch: Batch, name: str, twice: bool, observe: OnRecordedRun | None = None) -> None:
        self.name, self.batch = name, batch
        self.tracker: Any = None
        """Tracker with ``step(state, *arguments) -> (state, answer)``; set inside the context."""
        self._started: Any = None
        """Tracker without the wrapper that checks it by a second drive."""
        self.state: Any = None
        """State of the tracker; None before the first step."""
        self.failure: Failure | None = None
        self.engine: EngineUsed | None = None
        """Engine of a built-in tracker; set when the context is left."""
        self.random = False
        """Whether the tracker declares that it draws random numbers; set inside the context."""
        self._work, self._piece, self._twice = work, batch.pieces[0], twice
        self._scene = work.scenes[self._piece.scene]
        self._time = self._scene.truth.time[self._scene.instants()]
        self._scoring = batch.scoring(name, observe)
        self._delivery: Delivery | None = None
        self._began = 0.0
        self._step_by_step_until = 0
        self._metric_error: Exception | None = None
        self.answers: list[Any] = []
        """Tracker's answer at each instant; empty unless ``work.keeps_answers``."""

    @property
    def done(self) -> float:
        """Share of the instants that the tracker has reached."""
        return 0.0 if self._delivery is None else (self._delivery.instant + 1) / max(len(self._time), 1)

    def __enter__(self) -> Self:
        try:
            if self.name in self._work.external_tracks:
                return self
            self.tracker = self._started = self.batch.start(self.name)
            self.random = is_random(self.tracker)
            if self._twice:
                self.tracker = _with_second_drive(self._work, self.batch, self.name, self.tracker)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._note_error(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(self._started, ForeignTracker):
            self._started.close()
        elif self._started is not None:
            self.engine = getattr(self._started, "engine_used", None)
            if self.engine is not None and self._work.engine != self._work.engine_here:
                self.engine = self.engine._replace(why_numpy=unavailable() or "")
        passed_on = isinstance(error, KeyboardInterrupt) or (error is not None and error is self._metric_error)
        if error is not None and not passed_on:
            self._note_error(error)
        if isinstance(self.tracker, CrossCheckedTracker) and self.failure is None and not passed_on:
            disagreement = self.tracker.disagreement()
            if disagreement is not None:
                fault, scan = disagreement
                self._fail(fault, int(np.searchsorted(self._time, scan.time - SAME_TIME)), scan.sensor)
        return not passed_on

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        taken = 0
        for instant, group in enumerate(self._deliveries):
            if instant >= taken and self.failure is None:
                taken = instant + self._take_sequence(instant)
            if instant < taken:
                continue
            for delivery in group:
                if self.failure is not None:
                    return
                self._delivery = delivery
                arguments = self._arguments(delivery)
                self._began = time.perf_counter() - seconds_on_kernels(self._work.engine_here)
                yield arguments

    def take(self, answer: Any) -> None:
        """Score the tracker's answer to the arguments that the iteration yielded last."""
        delivery = self._delivery
        assert delivery is not None
        seconds = time.perf_counter() - seconds_on_kernels(self._work.engine_here) - self._began
        seconds = math.nan if isinstance(self.tracker, Offline) else seconds
        if delivery.last and self._work.keeps_answers:
            self.answers.append(answer)
        predicts = getattr(self.tracker, "multi_object", False) and delivery.scan.arrival_time == delivery.scan.time
        predicted = partial(self.tracker.predicted, self.state) if predicts else None
        try:
            self._scoring.take(delivery, answer, seconds, predicted)
        except Fault as fault:
            self._fail_at(fault)
        except Exception as error:
            self._metric_error = error
            raise

    def close(self) -> list[Outcome] | Failure:
        """Return the tracker's outcome (sums of scores) per block of runs, or its failure, once the context is left."""
        if self.failure is None:
            try:
                return self._scoring.close()
            except Fault as fault:
                self._fail_at(fault)
        assert self.failure is not None
        if isinstance(self._scoring, EstimateScoring):
            self._scoring.failed(self.failure.step or 0)
        return self.failure

    @cached_property
    def _deliveries(self) -> list[list[Delivery]]:
        """Scans that the tracker is given, one list for each instant."""
        if self.tracker is None:
            return []
        scans = self.batch.measurements.scans
        if isinstance(self.tracker, Offline):
            scans = [scan.prompt() for scan in scans]
        used = self._work.trackers[self.name].sensors_used
        return list(deliveries(scans, used, self._scene.each_measurement))

    def _arguments(self, delivery: Delivery) -> tuple[Scan, Indices] | tuple[Scan]:
        """Return the scan; for a tracker that uses origins, also the one or two objects that caused each detection."""
        measurements = self.batch.measurements
        if not measurements.origins or not getattr(self.tracker, "wants_origins", False):
            return (delivery.scan,)
        origins = np.stack([each[delivery.number or 0] for each in (measurements.origins, measurements.merged)])
        return delivery.scan, origins if delivery.read and delivery.number is not None else origins[:, :0]

    def _take_sequence(self, instant: int) -> int:
        """Step through instants from ``instant`` on by one sequence of kernel calls; return how many, 0 for none."""
        stepwise = self._work.engine_here == "numpy" or instant < self._step_by_step_until or self.state is None
        if stepwise or not isinstance(self.tracker, FilterTracker) or not isinstance(self._scoring, EstimateScoring):
            return 0
        if self._scoring.scorer.waits:
            return 0
        instants = self._deliveries[instant : instant + INSTANTS]
        taken = self._scoring.take_sequence(self.tracker, self.state, instants, instant)
        if taken is None:
            # Mostly a single instant is the reason: single steps lead past it.
            self._step_by_step_until = instant + self._scoring.scorer.chunk
            return 0
        self.state, count = taken
        return count

    def _note_error(self, error: BaseException) -> None:
        fault, begun = fault_of(error), self._delivery is not None
        instant, sensor = (0, None) if not self._delivery else (self._delivery.instant, self._delivery.scan.sensor)
        hint = self._scoring.hint(fault) if begun else ""
        if hint:
            fault = TrackFault(f"{fault.cause} ({hint})", fault.kind, fault.place, fault.member)
        self._fail(fault, instant, sensor)

    def _fail_at(self, fault: Fault) -> None:
        self._fail(TrackFault(fault.cause, "answer", member=fault.member), fault.instant, None)

    def _fail(self, fault: TrackFault, instant: int, sensor: str | None) -> None:
        object, run = (None, None) if fault.member is None else self._scoring.place(fault.member)
        self.failure = Failure(
            cause=fault.cause,
            place=fault.place,
            step=instant,
            time_s=float(self._time[instant]),
            sensor=sensor,
            object=object,
            run=None if run is None else self._work.number(self._piece.scene, self._piece.runs[run]),
        )


def _with_second_drive(work: Work, batch: Batch, name: str, tracker: Any) -> Any:
    """Wrap a plug-in so that a second drive checks it; built-in trackers and random ones are returned as they are.

    In the second drive a batched tracker gets half of the batch, permuted; any other gets two runs in reverse order.
    """
    config, (piece,) = work.driven(name), batch.pieces
    if not plugged_in(config) or is_random(tracker):
        return tracker
    random = stream(work.seed, work.noise_of(piece.scene), piece.runs.start, "second drive")
    if tracker.batched:
        order = random.permutation(batch.members)[batch.members // 2 :]
    else:
        runs = len(piece.runs)
        chosen = np.sort(random.permutation(runs)[:RUNS])
        # Members are numbered by object, then run.
        order = np.concatenate([np.arange(0, batch.members, runs) + run for run in chosen])[::-1]
    options = work.isolation, batch.multi_object, work.sensors
    start = partial(start_stepper, config, work.folder, len(order), work.prepare_tracker, *options)
    return CrossCheckedTracker(tracker, start, order)

"""One block of Monte-Carlo runs through every tracker."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Estimate, Gaussian, Progress, Scan, no_progress
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Offline, Stepper, masked
from trackbench.engine.choice import compute_by, seconds_on_kernels
from trackbench.engine.equations import EngineUsed
from trackbench.metrics import BlockScores, Scorer, Sums, score_together
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.estimates import ESTIMATES
from trackbench.results import Failure
from trackbench.runner.allocation import keep_freed_memory
from trackbench.runner.delivery import deliveries
from trackbench.runner.engines import engine_of
from trackbench.runner.modes import ModeSums
from trackbench.runner.prepare import stepper_of
from trackbench.runner.recorded import RecordedEstimates, RecordedInstant
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import Measurements, sense

#: Called with the recorded run while it is made: with its scans first, then with the estimates at each instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]


@dataclass
class Block:
    """What a block of runs leaves behind."""

    piece: BlockRuns
    sums: dict[str, Sums | Failure]
    """By tracker."""
    recorded: dict[str, RecordedEstimates]
    modes: dict[str, ModeSums]
    """By tracker that has modes."""
    scans: list[Scan] | None
    """Those of the recorded run, if it is in this block; batch axis ``(objects,)``."""
    detections: dict[str, Array]
    digests: list[bytes]
    engines: dict[str, EngineUsed]
    """By built-in tracker, what computed it."""

    @property
    def scores(self) -> dict[str, BlockScores | Failure]:
        """By tracker, the sums that the built-in metrics share."""
        return {
            name: found if isinstance(found, Failure) else found[ESTIMATES.name] for name, found in self.sums.items()
        }


def run_block(
    work: Work, piece: BlockRuns, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
) -> Block:
    """Synthesise the measurements of some runs and take every tracker through them.

    All trackers take the same stretch of instants before any goes on, so that they are scored where all of them gave an
    estimate.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
        on_recorded_run: called with the recorded run, if it is in this block.
    """
    keep_freed_memory()
    scene, runs = work.scenes[piece.scene], piece.runs
    measurements = sense(scene.sensors, work.seed, work.noise_of(piece.scene), runs)
    kept = work.recorded_run - runs.start if work.has_recorded_run(piece) else None
    scans = None if kept is None else [_of_run(scan, len(scene.truth.ids), kept) for scan in measurements.scans]
    targets = Targets(work, piece, measurements)
    trackers = {name: TrackerRun(work, name, piece, measurements, targets, kept) for name in work.trackers}
    observe = on_recorded_run if scans is not None else None
    if observe is not None and scans is not None:
        observe(scans)
    instants = len(scene.instants())
    chunk, done = next(iter(trackers.values())).chunk, 0
    for first in range(0, instants, chunk):
        here = range(first, min(first + chunk, instants))
        # One tracker after the other where nobody looks on: its state stays in the processor's cache.
        stretches = [here] if observe is None else [range(instant, instant + 1) for instant in here]
        for stretch in stretches:
            found: dict[str, Gaussian] = {}
            for name, tracker in trackers.items():
                for _ in stretch:
                    estimate = tracker.advance()
                    if estimate is not None:
                        found[name] = estimate
                    done += 1
                    progress(done / (instants * len(trackers)) * len(runs), len(runs))
            if observe is not None:
                observe(RecordedInstant(stretch.start, found))
        _score(list(trackers.values()))
    sums = {name: tracker.close() for name, tracker in trackers.items()}
    recorded = {name: tracker.recorded for name, tracker in trackers.items() if tracker.recorded is not None}
    modes = {name: tracker.modes for name, tracker in trackers.items() if tracker.modes is not None}
    engines = {name: tracker.engine for name, tracker in trackers.items() if tracker.engine is not None}
    return Block(piece, sums, recorded, modes, scans, measurements.detections, measurements.digests, engines)


def _score(trackers: Sequence[TrackerRun]) -> None:
    """Score what those that have not failed gave at the latest instants."""
    going = [tracker for tracker in trackers if tracker.failure is None]
    faults = score_together([tracker.scorer for tracker in going])
    for tracker in going:
        fault = faults.get(tracker.name)
        if fault is not None:
            tracker.fail(TrackFault(fault.cause, "answer", member=fault.member), fault.instant, None)


class TrackerRun:
    """One tracker's way through the measurements of a block."""

    def __init__(
        self,
        work: Work,
        name: str,
        piece: BlockRuns,
        measurements: Measurements,
        targets: Targets,
        kept: int | None,
    ) -> None:
        config = work.trackers[name]
        scene = work.scenes[piece.scene]
        self.name = name
        self.failure: Failure | None = None
        self.engine: EngineUsed | None = None
        """Known once it is closed, of a built-in tracker."""
        self._work, self._piece, self._scene, self._runs, self._kept = work, piece, scene, piece.runs, kept
        self._target = targets.of(config)
        self.scorer = Scorer(
            self._target,
            targets.conditions(config),
            {sensor.name: len(sensor.steps) for sensor in scene.sensors},
            tracker=name,
            first=piece.scene == piece.runs.start == 0,
            single=work.runs == len(work.scenes) == 1,
            metrics=work.metrics,
            compute=compute_by(work.engine_here),
        )
        objects, instants = len(scene.truth.ids), len(self._target.time)
        batch = objects * len(self._runs)
        self._none = Estimate(np.full((4, batch), np.nan), np.full((4, 4, batch), np.nan))
        self.recorded: RecordedEstimates | None = None
        if kept is not None:
            self.recorded = RecordedEstimates(
                np.full((4, instants, objects), np.nan),
                np.full((4, 4, instants, objects), np.nan),
                self._target.due[..., kept],
                {
                    sensor.name: [np.full(objects, np.nan)] * len(sensor.steps)
                    for sensor in scene.sensors
                    if len(sensor.steps)
                },
            )
            counts = dict.fromkeys(self.recorded.nis, 0)
            self._of_sensor: list[int] = []
            for scan in measurements.scans:
                self._of_sensor.append(counts[scan.sensor])
                counts[scan.sensor] += 1
        self.modes: ModeSums | None = None
        self._instants = self._through(measurements.scans)

    @property
    def chunk(self) -> int:
        """Number of instants that are scored at a time."""
        return self.scorer.chunk

    def advance(self) -> Gaussian | None:
        """Take the tracker through the next instant, unless it has failed.

        Returns:
            Its estimate of the recorded run; None where that is in another block.
        """
        return None if self.failure is not None else next(self._instants, None)

    def close(self) -> Sums | Failure:
        """What it left behind, once all instants were taken and scored."""
        self._instants.close()
        if self.failure is not None:
            return self.failure
        sums = self.scorer.close()
        scores: BlockScores = sums[ESTIMATES.name]
        if scores.due.sum() > 0 and not scores.errors:
            self.fail(TrackFault("it gave no estimate at all", "answer"), len(self._target.time) - 1, None)
        return self.failure or sums

    def _through(self, scans: Sequence[Scan]) -> Generator[Gaussian | None]:
        instant, scan = 0, scans[0]
        stepper: Stepper | None = None
        try:
            work, engine = self._work, self._work.engine_here
            given = (scan if self._reads(scan.sensor) else masked(scan) for scan in scans)
            stepper = stepper_of(work, self._piece, work.trackers[self.name], given)
            if isinstance(stepper, Offline):
                scans = [scan.prompt() for scan in scans]
            for instant, group in enumerate(deliveries(scans, self._reads, masked)):
                latest = self._none
                for scan, number, _ in group:
                    begin, making = time.perf_counter(), seconds_on_kernels(engine)
                    answer = stepper.step(scan)
                    seconds = time.perf_counter() - begin - (seconds_on_kernels(engine) - making)
                    # A smoother does not work step by step.
                    seconds = math.nan if isinstance(stepper, Offline) else seconds
                    latest = answer or self._none
                    self.scorer.scan(instant, scan, latest, seconds)
                    if number is not None:
                        self._keep_nis(number, scan, latest)
                self.scorer.estimate(latest)
                if latest.mode_probabilities is not None:
                    self.modes = self.modes or ModeSums(len(latest.mode_probabilities), self._target, self._kept)
                    self.modes.take(instant, latest.mode_probabilities, self._target)
                yield self._keep(instant, latest)
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            self.fail(fault_of(error), instant, scan.sensor)
        finally:
            if stepper is not None:
                self.engine = engine_of(work, stepper)
                stepper.close()

    def _reads(self, sensor: str) -> bool:
        named = self._work.trackers[self.name].sensors_used
        return named is None or sensor in named

    def _keep(self, instant: int, estimate: Estimate) -> Gaussian | None:
        """What the recorded run has of an estimate."""
        if self.recorded is None or self._kept is None:
            return None
        members = slice(self._kept, None, len(self._runs))
        alive = self._target.alive[instant]
        found = Gaussian(
            np.where(alive, estimate.mean[:, members], np.nan),
            np.where(alive, estimate.covariance[:, :, members], np.nan),
        )
        self.recorded.mean[:, instant], self.recorded.covariance[:, :, instant] = found
        return found

    def _keep_nis(self, number: int, scan: Scan, estimate: Estimate) -> None:
        if self.recorded is None or self._kept is None:
            return
        nis = np.full(len(self._scene.truth.ids), np.nan)
        members = slice(self._kept, None, len(self._runs))
        white = whitened_innovation(estimate, members)
        if white is not None:
            nis = np.where(scan.valid[members], np.einsum("i...,i...->...", white, white), np.nan)
        self.recorded.nis[scan.sensor][self._of_sensor[number]] = nis

    def fail(self, fault: TrackFault, instant: int, sensor: str | None) -> None:
        """Note that and where the tracker cannot go on."""
        at = None if fault.member is None else divmod(fault.member, len(self._runs))
        object, run = (None, None) if at is None else (self._scene.truth.ids[at[0]], at[1])
        where = {"step": instant, "time_s": float(self._target.time[instant]), "sensor": sensor, "object": object}
        self.failure = self._work.failure(self._piece, fault, run, **where)


def _of_run(scan: Scan, objects: int, run: int) -> Scan:
    members = slice(run, None, scan.valid.size // objects)
    return scan._replace(measurement=scan.measurement[:, members].copy(), valid=scan.valid[members].copy())

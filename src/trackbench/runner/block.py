"""One block of Monte-Carlo runs through every tracker."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, groupby, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.metrics import BUILT_IN, Fault, Metric, Scorer, Scores, Sums, Target
from trackbench.metrics.conditions import conditions
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.estimates import ESTIMATES
from trackbench.models.motion import Kinematics
from trackbench.results import Failure
from trackbench.runner.adapters import TrackFault, adapt, cause_of, masked
from trackbench.runner.allocation import keep_freed_memory
from trackbench.sensing.scans import IdealSensor, Measurements, sense
from trackbench.streams import stream
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.types import Array, Estimate, Gaussian, Indices, Progress, Scan, Truth, no_progress

#: Numbers of objects and runs whose product makes one block; a step of a filter on it fits the cache.
BATCH_SIZE = 2000


@dataclass(frozen=True)
class Work:
    """Everything that is the same for every block of a run."""

    scenario: str
    seed: int
    runs: int
    truth: Truth
    sensors: list[IdealSensor]
    trackers: Mapping[str, FilterConfig | PluginConfig]
    folder: Path | None
    """Where a tracker's module is looked for first."""
    settle: float
    divergence: float
    recorded_run: int
    metrics: tuple[Metric, ...] = BUILT_IN

    def blocks(self) -> list[range]:
        """The runs in blocks, which depend on the numbers of runs and objects alone."""
        size = max(1, BATCH_SIZE // max(1, len(self.truth.ids)))
        return [range(first, min(first + size, self.runs)) for first in range(0, self.runs, size)]

    def instants(self) -> Indices:
        """Indices of the truth's steps at which any sensor takes a measurement."""
        return np.unique(np.concatenate([sensor.steps for sensor in self.sensors]))


@dataclass
class RecordedEstimates:
    """One tracker's estimates of the recorded run."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, instants, objects)``"""
    nis: dict[str, list[Array]] = field(default_factory=dict)
    """Per sensor and measurement ``(objects,)``, NaN where there is none."""


class RecordedInstant(NamedTuple):
    """The estimates of the recorded run at one instant."""

    number: int
    """Of the instant, from 0."""
    estimates: dict[str, Gaussian]
    """By tracker that has not failed: mean ``(4, objects)``, NaN where there is none, and covariance."""


#: Called with the recorded run while it is made: with its scans first, then with the estimates at each instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]


@dataclass
class Block:
    """What a block of runs leaves behind."""

    runs: range
    sums: dict[str, Sums | Failure]
    """By tracker."""
    recorded: dict[str, RecordedEstimates]
    scans: list[Scan] | None
    """Those of the recorded run, if it is in this block; batch axis ``(objects,)``."""
    detections: dict[str, Array]
    digests: list[bytes]

    @property
    def scores(self) -> dict[str, Scores | Failure]:
        """By tracker, the sums that the built-in metrics share."""
        return {
            name: found if isinstance(found, Failure) else found[ESTIMATES.name] for name, found in self.sums.items()
        }


def run_block(
    work: Work, runs: range, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
) -> Block:
    """Synthesise the measurements of some runs and take every tracker through them.

    Args:
        work: what all blocks share.
        runs: those of this block.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
        on_recorded_run: called with the recorded run, if it is in this block.
    """
    keep_freed_memory()
    measurements = sense(work.sensors, work.seed, work.scenario, runs)
    target = _target(work, measurements, runs)
    kept = work.recorded_run - runs.start if work.recorded_run in runs else None
    scans = None if kept is None else [_of_run(scan, len(work.truth.ids), kept) for scan in measurements.scans]
    tracker_runs = {name: TrackerRun(work, name, runs, measurements, target, kept) for name in work.trackers}
    each = [tracker_run.instants() for tracker_run in tracker_runs.values()]
    instants = len(target.time)
    if on_recorded_run is None or scans is None:
        # One tracker after the other: its state stays in the processor's cache.
        for done, _ in enumerate(chain(*each), start=1):
            progress(done / (instants * len(each)) * len(runs), len(runs))
    else:
        on_recorded_run(scans)
        for number, estimates in enumerate(zip_longest(*each)):
            known = {name: found for name, found in zip(tracker_runs, estimates, strict=True) if found is not None}
            on_recorded_run(RecordedInstant(number, known))
            progress((number + 1) / instants * len(runs), len(runs))
    sums = {name: tracker_run.sums for name, tracker_run in tracker_runs.items()}
    recorded = {name: item.recorded for name, item in tracker_runs.items() if item.recorded is not None}
    return Block(runs, sums, recorded, scans, measurements.detections, measurements.digests)


class TrackerRun:
    """One tracker's way through the measurements of a block."""

    def __init__(
        self,
        work: Work,
        name: str,
        runs: range,
        measurements: Measurements,
        target: Target,
        kept: int | None,
    ) -> None:
        self._work = work
        self._name = name
        self._runs = runs
        self._measurements = measurements
        self._target = target
        self._kept = kept
        objects, instants = len(work.truth.ids), len(target.time)
        self._none = Estimate(np.full((4, objects * len(runs)), np.nan), np.full((4, 4, objects * len(runs)), np.nan))
        self.sums: Sums | Failure
        """Once all instants have been taken."""
        self.recorded: RecordedEstimates | None = None
        if kept is not None:
            self.recorded = RecordedEstimates(
                np.full((4, instants, objects), np.nan), np.full((4, 4, instants, objects), np.nan)
            )

    def instants(self) -> Iterator[Gaussian | None]:
        """Take the tracker through one instant after the other, to the last one or until it fails.

        Yields:
            At each instant its estimate of the recorded run, None where that is in another block.
        """
        self.sums = yield from self._instants()

    def _instants(self) -> Generator[Gaussian | None, None, Sums | Failure]:
        work = self._work
        config = work.trackers[self._name]
        counts = {sensor.name: len(sensor.steps) for sensor in work.sensors}
        read = [sensor for sensor in work.sensors if config.sensors is None or sensor.name in config.sensors]
        classes = conditions(work.truth, work.instants(), read, self._runs)
        scorer = Scorer(self._target, classes, counts, self._runs.start == 0, work.metrics)
        named = config.sensors_used
        instant, scan = 0, self._measurements.scans[0]
        try:
            stepper = adapt(config, work.folder, self._none.mean.shape[1], self._primed)
            for instant, (_, group) in enumerate(groupby(self._measurements.scans, key=lambda item: item.time)):
                latest = self._none
                for scan in group:
                    given = scan if named is None or scan.sensor in named else masked(scan)
                    begin = time.perf_counter()
                    answer = stepper.step(given)
                    seconds = time.perf_counter() - begin
                    latest = answer or self._none
                    scorer.scan(instant, given, latest, seconds)
                    self._keep_nis(given, latest)
                scorer.estimate(latest)
                yield self._keep(instant, latest)
            sums = scorer.close()
        except Fault as fault:
            return self._failure(fault.cause, fault.instant, None, fault.member)
        except TrackFault as fault:
            return self._failure(cause_of(fault.cause), instant, scan.sensor, fault.member)
        except (Exception, SystemExit) as error:
            return self._failure(cause_of(error), instant, scan.sensor, None)
        scores = sums[ESTIMATES.name]
        if scores.present.sum() > 0 and scores.per_step[0].sum() == 0:
            return self._failure("it gave no estimate at all", instant, None, None)
        return sums

    def _primed(self, tracker: FilterTracker) -> FilterTracker:
        """The tracker, given its first states drawn from the truth if that is how it starts."""
        work, truth = self._work, self._work.truth
        # When it starts must not depend on sensors that it does not read.
        own = [sensor.steps for sensor in work.sensors if tracker.advances(sensor.name)]
        if not tracker.starts_from_truth or not own:
            return tracker
        instants = np.unique(np.concatenate(own))
        objects = np.arange(len(truth.ids))
        first = instants[np.argmax(truth.alive[instants], axis=0)]
        shape = (len(objects), len(self._runs))

        def at_start(values: Array) -> Array:
            found = values[first, objects]
            own = found if found.shape[1] == 1 else found[:, self._runs.start : self._runs.stop]
            return np.broadcast_to(own, shape).reshape(-1)

        fields = (truth.px, truth.py, truth.speed, truth.course, truth.acceleration, truth.yaw_rate)
        motion = Kinematics(*(at_start(values) for values in fields))
        size = max(6, len(tracker.filter.motion.components))
        normal = np.stack(
            [
                stream(work.seed, work.scenario, run, "initial state").standard_normal((size, len(objects)))
                for run in self._runs
            ],
            axis=-1,
        )
        when = np.where(truth.alive[instants].any(axis=0), truth.time[first], np.inf)
        times = np.broadcast_to(when[:, None], shape).reshape(-1)
        return tracker.with_prior(times, motion, normal.reshape(size, -1))

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

    def _keep_nis(self, scan: Scan, estimate: Estimate) -> None:
        if self.recorded is None or self._kept is None:
            return
        nis = np.full(len(self._work.truth.ids), np.nan)
        members = slice(self._kept, None, len(self._runs))
        white = whitened_innovation(estimate, members)
        if white is not None:
            nis = np.where(scan.valid[members], np.einsum("i...,i...->...", white, white), np.nan)
        self.recorded.nis.setdefault(scan.sensor, []).append(nis)

    def _failure(self, cause: str, instant: int, sensor: str | None, member: int | None) -> Failure:
        at = None if member is None else divmod(member, len(self._runs))
        return Failure(
            cause=cause,
            step=instant,
            time_s=float(self._target.time[instant]),
            sensor=sensor,
            run=None if at is None else self._runs.start + at[1],
            object=None if at is None else self._work.truth.ids[at[0]],
        )


def _target(work: Work, measurements: Measurements, runs: range) -> Target:
    truth, instants = work.truth, work.instants()
    state = np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, instants]
    if state.shape[-1] > 1:
        state = state[..., runs.start : runs.stop]
    shape = (len(truth.ids), len(runs))
    start = np.full(shape, np.inf)
    for scan in reversed(measurements.scans):
        start = np.where(scan.valid.reshape(shape), scan.time, start)
    return Target(truth.time[instants], state, truth.alive[instants], start + work.settle, work.divergence)


def _of_run(scan: Scan, objects: int, run: int) -> Scan:
    members = slice(run, None, scan.valid.size // objects)
    return scan._replace(measurement=scan.measurement[:, members].copy(), valid=scan.valid[members].copy())

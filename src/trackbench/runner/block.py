"""One block of Monte-Carlo runs through every tracker."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.metrics.conditions import conditions
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.scorer import Fault, Scorer, Target
from trackbench.metrics.scores import Scores
from trackbench.models.motion import Kinematics
from trackbench.runner.adapters import TrackFault, adapt, cause_of, masked
from trackbench.runner.allocation import keep_freed_memory
from trackbench.sensing.scans import IdealSensor, Measurements, sense
from trackbench.streams import stream
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.types import Array, Estimate, Indices, Progress, Scan, Truth, no_progress

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

    def blocks(self) -> list[range]:
        """The runs in blocks, which depend on the numbers of runs and objects alone."""
        size = max(1, BATCH_SIZE // max(1, len(self.truth.ids)))
        return [range(first, min(first + size, self.runs)) for first in range(0, self.runs, size)]

    def instants(self) -> Indices:
        """Indices of the truth's steps at which any sensor takes a measurement."""
        return np.unique(np.concatenate([sensor.steps for sensor in self.sensors]))


@dataclass(frozen=True)
class Failure:
    """Why and where a tracker could not go on."""

    cause: str
    step: int
    """Number of the instant, from 0."""
    time_s: float
    sensor: str | None
    run: int | None
    object: str | None


@dataclass
class RecordedEstimates:
    """One tracker's estimates of the recorded run."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, instants, objects)``"""
    nis: dict[str, list[Array]] = field(default_factory=dict)
    """Per sensor and measurement ``(objects,)``, NaN where there is none."""


class Observation(NamedTuple):
    """What a tracker says of the recorded run at one instant."""

    tracker: str
    instant: int
    """Number of the instant, from 0."""
    mean: Array
    """``(4, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, objects)``"""


#: Is told what the recorded run is like while it is made: its scans first, then each tracker's estimates.
Observer = Callable[[list[Scan] | Observation], None]


@dataclass
class Block:
    """What a block of runs leaves behind."""

    runs: range
    scores: dict[str, Scores | Failure]
    recorded: dict[str, RecordedEstimates]
    scans: list[Scan] | None
    """Those of the recorded run, if it is in this block; batch axis ``(objects,)``."""
    detections: dict[str, Array]
    digests: list[bytes]


def run_block(work: Work, runs: range, progress: Progress = no_progress, observer: Observer | None = None) -> Block:
    """Synthesise the measurements of some runs and take every tracker through them.

    Args:
        work: what all blocks share.
        runs: those of this block.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
        observer: called from within if the recorded run is among them.
    """
    keep_freed_memory()
    measurements = sense(work.sensors, work.seed, work.scenario, runs)
    target = _target(work, measurements, runs)
    kept = work.recorded_run - runs.start if work.recorded_run in runs else None
    scans = None if kept is None else [_of_run(scan, len(work.truth.ids), kept) for scan in measurements.scans]
    if observer is not None and scans is not None:
        observer(scans)
    scores: dict[str, Scores | Failure] = {}
    recorded: dict[str, RecordedEstimates] = {}
    for done, name in enumerate(work.trackers):

        def reached(share: float, done: int = done) -> None:
            progress((done + share) / len(work.trackers) * len(runs), len(runs))

        passage = TrackerRun(work, name, runs, measurements, target, kept, reached, observer)
        scores[name] = passage.take()
        if passage.recorded is not None:
            recorded[name] = passage.recorded
    return Block(runs, scores, recorded, scans, measurements.detections, measurements.digests)


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
        reached: Callable[[float], None],
        observer: Observer | None,
    ) -> None:
        self._reached = reached
        self._work = work
        self._name = name
        self._observer = observer
        self._runs = runs
        self._measurements = measurements
        self._target = target
        self._kept = kept
        objects, instants = len(work.truth.ids), len(target.time)
        self._none = Estimate(np.full((4, objects * len(runs)), np.nan), np.full((4, 4, objects * len(runs)), np.nan))
        self.recorded: RecordedEstimates | None = None
        if kept is not None:
            self.recorded = RecordedEstimates(
                np.full((4, instants, objects), np.nan), np.full((4, 4, instants, objects), np.nan)
            )

    def take(self) -> Scores | Failure:
        """The tracker's scores, or why there are none."""
        work = self._work
        config = work.trackers[self._name]
        counts = {sensor.name: len(sensor.steps) for sensor in work.sensors}
        read = [sensor for sensor in work.sensors if config.sensors is None or sensor.name in config.sensors]
        classes = conditions(work.truth, work.instants(), read, self._runs)
        scorer = Scorer(self._target, classes, counts, keep_spread=self._runs.start == 0)
        named = config.sensors_used
        instant, scan = 0, self._measurements.scans[0]
        seconds, steps = 0.0, 0
        try:
            stepper = adapt(config, work.folder, self._none.mean.shape[1], self._primed)
            for instant, (_, group) in enumerate(groupby(self._measurements.scans, key=lambda item: item.time)):
                latest = self._none
                for scan in group:
                    given = scan if named is None or scan.sensor in named else masked(scan)
                    begin = time.perf_counter()
                    answer = stepper.step(given)
                    seconds += time.perf_counter() - begin
                    steps += given.valid.size
                    latest = answer or self._none
                    scorer.innovation(instant, given, latest)
                    self._keep_nis(given, latest)
                scorer.estimate(latest)
                self._keep(instant, latest)
                self._reached((instant + 1) / len(self._target.time))
            scores = scorer.scores(seconds, steps)
        except Fault as fault:
            return self._failure(fault.cause, fault.instant, None, fault.member)
        except TrackFault as fault:
            return self._failure(cause_of(fault.cause), instant, scan.sensor, fault.member)
        except (Exception, SystemExit) as error:
            return self._failure(cause_of(error), instant, scan.sensor, None)
        if scores.present.sum() > 0 and scores.per_step[0].sum() == 0:
            return self._failure("it gave no estimate at all", instant, None, None)
        return scores

    def _primed(self, tracker: FilterTracker) -> FilterTracker:
        """The tracker, given its first states drawn from the truth if that is how it starts."""
        if not tracker.starts_from_truth:
            return tracker
        work, truth = self._work, self._work.truth
        instants = work.instants()
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

    def _keep(self, instant: int, estimate: Estimate) -> None:
        if self.recorded is not None and self._kept is not None:
            members = slice(self._kept, None, len(self._runs))
            alive = self._target.alive[instant]
            self.recorded.mean[:, instant] = np.where(alive, estimate.mean[:, members], np.nan)
            self.recorded.covariance[:, :, instant] = np.where(alive, estimate.covariance[:, :, members], np.nan)
            if self._observer is not None:
                mean, covariance = self.recorded.mean[:, instant], self.recorded.covariance[:, :, instant]
                self._observer(Observation(self._name, instant, mean, covariance))

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

"""Batches: the runs that a tracker processes together, with known or with hidden identities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Scan, of_runs, scan_of_run
from trackbench.driving.drive import scans_read
from trackbench.driving.start import start_stepper
from trackbench.driving.steppers import Offline
from trackbench.models.motion import Kinematics
from trackbench.runner.recorded import OnRecordedRun, RecordedScans
from trackbench.runner.scored_estimates import EstimateScoring
from trackbench.runner.scored_tracks import TrackScoring
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import scenes_side_by_side, sense_hidden
from trackbench.sensing.scans import Measurements, sense_known
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker, SmoothedTracker


class KnownIdentities:
    """Batch of runs of one scene in which each measurement names its object; a member is one object in one run."""

    multi_object = False
    """Whether the tracker follows several objects."""

    def __init__(self, work: Work, piece: BlockRuns) -> None:
        self._work, self._piece, self._scene = work, piece, work.scenes[piece.scene]
        self.pieces: Sequence[BlockRuns] = [piece]
        self.measurements = sense_known(self._scene.sensors, work.seed, work.noise_of(piece.scene), piece.runs)
        self._targets = Targets(work, piece, self.measurements)

    @property
    def members(self) -> int:
        """Number of members of the batch: objects times runs."""
        return len(self._scene.truth.ids) * len(self._piece.runs)

    def start(self, name: str) -> Any:
        """Return a fresh tracker; a smoother is given all scans of the runs here."""
        work, entry = self._work, self._work.driven(name)
        with_states = partial(_with_initial_states, work, self._piece)
        if isinstance(entry, FilterConfig) and entry.smoother is not None:
            tracker = SmoothedTracker(with_states(replace(build(entry).tracker, engine=work.engine_here)))
            return Offline(tracker, list(scans_read(self.measurements.scans, entry.sensors_used)))
        prepare = partial(work.prepare_tracker, change=with_states)
        return start_stepper(entry, work.folder, self.members, prepare, work.isolation, sensors=work.sensors)

    def scoring(self, name: str, observe: OnRecordedRun | None) -> EstimateScoring:
        """Return the scorer of a tracker's estimates; it passes the recorded run (kept for plots) to ``observe``."""
        return EstimateScoring(self._work, self._piece, name, self._targets, observe)

    def recorded_scans(self, observe: OnRecordedRun | None) -> RecordedScans | None:
        """Pass the scans of the recorded run (the run that is kept for plots) to ``observe``, and return the scans.

        The result is None if that run is in another block.
        """
        run = self._work.recorded_in(self._piece)
        if run is None:
            return None
        scans = [_of_run(scan, len(self._scene.truth.ids), run) for scan in self.measurements.scans]
        if observe is not None:
            observe(scans)
        return RecordedScans(scans)


class HiddenIdentities:
    """Batch of runs in which no detection names its object, of scenes with the same times; a member is one run."""

    multi_object = True

    def __init__(self, work: Work, pieces: Sequence[BlockRuns], measurements: Measurements) -> None:
        self._work, self.pieces, self.measurements = work, pieces, measurements

    @classmethod
    def of(cls, work: Work, piece: BlockRuns) -> HiddenIdentities:
        """Return the batch of some runs of one scene, with their detections."""
        sensors, noise = work.scenes[piece.scene].sensors, work.noise_of(piece.scene)
        return cls(work, [piece], sense_hidden(sensors, work.seed, noise, piece.runs))

    @property
    def members(self) -> int:
        """Number of members of the batch: runs."""
        return sum(len(piece.runs) for piece in self.pieces)

    def start(self, name: str) -> Any:
        work, options = self._work, (self._work.isolation, True, self._work.sensors)
        return start_stepper(work.driven(name), work.folder, self.members, work.prepare_tracker, *options)

    def scoring(self, name: str, observe: OnRecordedRun | None) -> TrackScoring:
        """Return the object that scores a tracker's tracks; ``observe`` is not called."""
        return TrackScoring(self._work, self.pieces, name, self.measurements)

    def recorded_scans(self, observe: OnRecordedRun | None) -> RecordedScans | None:
        """Return scans and origins of the recorded run (kept for plots), without calling ``observe``.

        The result is None if that run is in another block.
        """
        (piece,), measurements = self.pieces, self.measurements
        run = self._work.recorded_in(piece)
        if run is None:
            return None
        pairs = zip(measurements.scans, measurements.origins, strict=True)
        number = self._work.recorded_run
        return RecordedScans(
            [scan_of_run(scan, run) for scan in measurements.scans],
            [origins[scan.valid[:, run], run] for scan, origins in pairs],
            of_runs(self._work.scenes[piece.scene].due.status, range(number, number + 1))[..., 0],
        )


#: Runs that a tracker processes together, block after block, with their measurements.
Batch = KnownIdentities | HiddenIdentities


def batches_of(work: Work, group: Sequence[BlockRuns]) -> tuple[Sequence[Batch], Sequence[Batch]]:
    """Return the batches for plug-ins, one per block of runs, and the batches for built-in trackers.

    With hidden identities built-in trackers get a single batch with all blocks.
    """
    if not work.hidden:
        batches = [KnownIdentities(work, piece) for piece in group]
        return batches, batches
    blocks = [HiddenIdentities.of(work, piece) for piece in group]
    joined = scenes_side_by_side([block.measurements for block in blocks])
    return blocks, [HiddenIdentities(work, group, joined)]


def _of_run(scan: Scan, objects: int, run: int) -> Scan:
    members = slice(run, None, scan.valid.size // objects)
    return scan._replace(measurement=scan.measurement[:, members].copy(), valid=scan.valid[members].copy())


def _with_initial_states(work: Work, piece: BlockRuns, tracker: FilterTracker) -> FilterTracker:
    """Return the tracker with initial states drawn around the truth, if its tracks start from the truth."""
    scene, runs = work.scenes[piece.scene], piece.runs
    truth = scene.truth
    # The start must not depend on sensors that the tracker does not read.
    sensor_steps = [sensor.steps for sensor in scene.sensors if tracker.advances(sensor.name)]
    if not tracker.starts_from_truth or not sensor_steps:
        return tracker
    instants = np.unique(np.concatenate(sensor_steps))
    objects = np.arange(len(truth.ids))
    first = instants[np.argmax(truth.alive[instants], axis=0)]
    shape = (len(objects), len(runs))

    def at_start(values: Array) -> Array:
        start = of_runs(values[first, objects], runs)
        return np.broadcast_to(start, shape).reshape(-1)

    fields = (truth.px, truth.py, truth.speed, truth.course, truth.acceleration, truth.yaw_rate)
    motion = Kinematics(*(at_start(values) for values in fields))
    size = max(6, *(len(motion.components) for motion in tracker.filter.motions))
    draws = [
        stream(work.seed, work.noise_of(piece.scene), run, "initial state").standard_normal((size, len(objects)))
        for run in runs
    ]
    normal = np.stack(draws, axis=-1).reshape(size, -1)
    when = np.where(truth.alive[instants].any(axis=0), truth.time[first], np.inf)
    times = np.broadcast_to(when[:, None], shape).reshape(-1)
    return tracker.with_prior(times, motion, normal)

"""References for the scores in a block of runs: true states, when they are scored, and error bounds."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, islice

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Mask, Scan, of_runs
from trackbench.driving.drive import deliveries
from trackbench.engine.choice import compute_by
from trackbench.metrics import Target
from trackbench.metrics.conditions import FIRST, Classes, condition_classes, out_of_view
from trackbench.metrics.missing_estimates import measured_positions
from trackbench.metrics.reference import BoundStart, ConditionalBound
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.runner.work import BlockRuns, Work
from trackbench.scenario.keys import TrackerEntry
from trackbench.sensing.scans import Measurements
from trackbench.trackers.config import FilterConfig


class Targets:
    """Ground truth that each tracker in a block is scored against; what trackers share is computed once."""

    def __init__(self, work: Work, piece: BlockRuns, measurements: Measurements) -> None:
        self._work, self._piece = work, piece
        self._scene = work.scenes[piece.scene]
        assert work.reference is not None
        self._motion = work.reference
        truth, instants = self._scene.truth, self._scene.instants()
        runs = piece.runs
        self.state = of_runs(self._scene.scored.state[:, instants], runs)
        """``(4, instants, objects, runs or 1)`` true px, py, vx, vy."""
        self._time, self._alive = truth.time[instants], truth.alive[instants]
        shape = (len(truth.ids), len(runs))
        self._valid: dict[str, Mask] = {
            sensor.name: np.stack([scan.valid for scan in measurements.scans if scan.sensor == sensor.name]).reshape(
                -1, *shape
            )
            for sensor in self._scene.sensors
        }
        placing = {s.name for s in self._scene.sensors if s.config.measures_position()}
        self._placing = placing or {*self._valid}
        """Names of the sensors that measure a position; names of all sensors where none does."""
        self._arrival = {
            name: np.array([scan.arrival_time for scan in measurements.scans if scan.sensor == name])
            for name in self._valid
        }
        self._order = {name: np.argsort(arrival, kind="stable") for name, arrival in self._arrival.items()}
        self.measurements, self.scans = measurements, measurements.scans
        self.due, self.starting = self._where_due(shape)
        """``(instants, objects, runs)`` True where an estimate is scored, and in the second after a first detection."""
        self._measured: dict[frozenset[str], tuple[Iterator[Array], list[Array]]] = {}
        self._conditions: dict[frozenset[str], Classes] = {}
        self._references: dict[tuple[frozenset[str], BoundStart], Array] = {}

    def of(self, tracker: TrackerEntry) -> Target:
        """Return the ground truth that one tracker is scored against, with the bound for its sensors."""
        case = frozenset(tracker.sensors_used or self._valid), _start(tracker, self._motion.velocity_sigma)
        if case not in self._references:
            self._references[case] = self._reference(*case)
        return Target(
            self._time, self.state, self._alive, self.due, self.starting, self._work.divergence, self._references[case]
        )

    def measured(self, tracker: TrackerEntry, instants: slice) -> Array:
        """Return the latest measured position of each object at some instants, ``(2, instants, batch)`` m.

        See :func:`trackbench.metrics.missing_estimates.measured_positions`. Later instants are not computed, since most
        missing estimates are at the start.
        """
        sensors = frozenset(tracker.sensors_used or self._valid)
        if sensors not in self._measured:
            options = tracker.sensors_used, self._scene.each_measurement
            position = partial(_position, self.scans, self._placing)
            self._measured[sensors] = measured_positions(self.scans, position, *options), []
        remaining, positions = self._measured[sensors]
        positions.extend(islice(remaining, max(0, instants.stop - len(positions))))
        return np.stack(positions[instants], axis=1)

    def conditions(self, tracker: TrackerEntry) -> Classes:
        """Return each object's class of manoeuvre, range, age and jump, as the sensors of a tracker see the object."""
        sensors = frozenset(self._valid if tracker.sensors is None else tracker.sensors)
        if sensors not in self._conditions:
            read = [sensor for sensor in self._scene.sensors if sensor.name in sensors]
            scene = self._scene
            self._conditions[sensors] = condition_classes(scene.truth, scene.instants(), read, self._piece.runs)
        return self._conditions[sensors]

    def _where_due(self, shape: tuple[int, int]) -> tuple[Mask, Mask]:
        """Return where estimates are scored, and where it is the first second after an object's first detection.

        Both are ``(instants, objects, runs)`` and equal for all trackers, whichever sensors they read. An estimate is
        due from the first detection with a position; with any detection if no sensor measures positions. An object that
        was out of view for long is due again from its next detection on.
        """
        runs, scene = self._piece.runs, self._scene
        views = [(sensor, of_runs(sensor.in_view, runs)) for sensor in scene.sensors]
        lost = out_of_view(scene.truth.time, scene.instants(), views) > self._work.lost_after
        last_lost = np.maximum.accumulate(np.where(lost, self._time[:, None, None], -np.inf), axis=0)
        latest = {name: _latest_detection(valid[self._order[name]]) for name, valid in self._valid.items()}
        before = self._arrived(last_lost)

        def detected_within(numbers: Mapping[str, Indices]) -> Mask:
            """Return at which instants ``(instants, objects, runs)`` an object was detected since it was last lost.

            Args:
                numbers: number of scans ``(instants,)`` to search, from the first to arrive, by sensor.
            """
            detected = np.zeros((len(self._time), *shape), dtype=bool)
            for name in self._placing:
                detected |= latest[name][numbers[name]] > before[name].astype(latest[name].dtype)
            return detected

        seen_for = {age: detected_within(self._arrived(self._time - age)) for age in {self._work.settle, FIRST} - {0.0}}
        seen_for[0.0] = detected_within(self._delivered())
        in_view = self._alive[:, :, None] & ~lost
        return in_view & seen_for[self._work.settle], in_view & seen_for[0.0] & ~seen_for[FIRST]

    def _delivered(self) -> dict[str, Indices]:
        """Return the number of scans ``(instants,)`` that a tracker had been given by each instant, by sensor."""
        number = {name: np.zeros(len(self._time), dtype=np.intp) for name in self._valid}
        for delivery in chain.from_iterable(deliveries(self.scans, each_measurement=self._scene.each_measurement)):
            if delivery.number is not None:
                number[delivery.scan.sensor][delivery.instant] += 1
        return {name: np.cumsum(of_sensor) for name, of_sensor in number.items()}

    def _arrived(self, until: Array) -> dict[str, Indices]:
        """Return the number of scans that had arrived at each of the times ``until``, by sensor."""
        arrival = {name: self._arrival[name][order] for name, order in self._order.items()}
        return {name: np.searchsorted(times, until + SAME_TIME, side="right") for name, times in arrival.items()}

    def _reference(self, sensors: frozenset[str], start: BoundStart) -> Array:
        """Return Cramér-Rao bounds ``(2, instants, ...)`` on the variance of position and velocity; 0 where unknown."""
        scene, work = self._scene, self._work
        if scene.point != "centre":
            # The bound holds for the measured point only.
            return np.zeros((2, len(self._time), 1, 1))
        steps, number = np.unique(scene.instants(), return_inverse=True)
        case = sensors, start
        if case not in scene.bounds:
            scene.bounds[case] = ConditionalBound(
                scene.truth,
                {name: each for name, each in scene.information.items() if name in sensors},
                self._motion.acceleration,
                start,
                steps,
                np.arange(len(scene.truth.time)) if self._motion.as_drawn else None,
            )
        bound = scene.bounds[case].of_runs(self._valid, compute_by(work.engine_here))
        return bound if np.array_equal(number, np.arange(len(steps))) else bound[:, number]


def _latest_detection(valid: Mask) -> Indices:
    """Return which of the first 0, 1, 2, ... scans last detected each object: ``(scans + 1, objects, runs)``.

    Scans count from 1; 0 means that none did.
    """
    kind = np.min_scalar_type(-len(valid) - 1)
    latest = np.zeros((len(valid) + 1, *valid.shape[1:]), dtype=kind)
    for number, detected in enumerate(valid, 1):
        np.maximum(latest[number - 1], detected * kind.type(number), out=latest[number])
    return latest


def _position(scans: Sequence[Scan], placing: Collection[str], number: int) -> Array:
    """Return the measured positions in a scan, ``(2, batch)`` m; the sensor's own where no sensor measures any."""
    scan = scans[number]
    if scan.sensor in placing and not SENSOR_MODELS[scan.kind].measures_position():
        return np.broadcast_to(scan.sensor_pose[:2, None], (2, scan.valid.size))
    return SENSOR_MODELS[scan.kind].position(scan).mean


def _start(tracker: TrackerEntry, velocity_sigma: float) -> BoundStart:
    if isinstance(tracker, FilterConfig) and tracker.initial.source == "truth":
        return BoundStart(tracker.initial.velocity_sigma_mps, tracker.initial.position_sigma_m)
    return BoundStart(velocity_sigma)

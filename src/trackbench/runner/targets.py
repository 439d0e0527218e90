"""What the trackers of a block of runs are held against."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice

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
    """The target of each tracker; its parts are computed once for all trackers that share them."""

    def __init__(self, work: Work, piece: BlockRuns, measurements: Measurements) -> None:
        self._work, self._piece = work, piece
        self._scene = work.scenes[piece.scene]
        assert work.reference is not None
        self._motion = work.reference
        truth, instants = self._scene.truth, self._scene.instants()
        runs = piece.runs
        self.state = of_runs(self._scene.scored.state[:, instants], runs)
        """``(4, instants, objects, runs or 1)``"""
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
        """Names of the sensors that measure a position; all where none does."""
        self._arrival = {
            name: np.array([scan.arrival_time for scan in measurements.scans if scan.sensor == name])
            for name in self._valid
        }
        self._order = {name: np.argsort(arrival, kind="stable") for name, arrival in self._arrival.items()}
        self.measurements, self.scans = measurements, measurements.scans
        self.due, self.starting = self._where_due(shape)
        """``(instants, objects, runs)``"""
        self._measured: dict[frozenset[str], tuple[Iterator[Array], list[Array]]] = {}
        self._conditions: dict[frozenset[str], Classes] = {}
        self._references: dict[tuple[frozenset[str], BoundStart], Array] = {}

    def of(self, tracker: TrackerEntry) -> Target:
        """What a tracker is held against."""
        case = frozenset(tracker.sensors_used or self._valid), _start(tracker, self._motion.velocity_sigma)
        if case not in self._references:
            self._references[case] = self._reference(*case)
        return Target(
            self._time, self.state, self._alive, self.due, self.starting, self._work.divergence, self._references[case]
        )

    def measured(self, tracker: TrackerEntry, here: slice) -> Array:
        """Return the ``measured_positions`` of :mod:`trackbench.metrics.missing_estimates` at some instants.

        Nothing is computed of those after them: most estimates that are missing are at the start.
        """
        sensors = frozenset(tracker.sensors_used or self._valid)
        if sensors not in self._measured:
            options = tracker.sensors_used, self._scene.each_measurement
            position = partial(_position, self.scans, self._placing)
            self._measured[sensors] = measured_positions(self.scans, position, *options), []
        coming, positions = self._measured[sensors]
        positions.extend(islice(coming, max(0, here.stop - len(positions))))
        return np.stack(positions[here], axis=1)

    def conditions(self, tracker: TrackerEntry) -> Classes:
        """``(instants, objects, runs or 1)`` the class of each object, by what the tracker reads."""
        sensors = frozenset(self._valid if tracker.sensors is None else tracker.sensors)
        if sensors not in self._conditions:
            read = [sensor for sensor in self._scene.sensors if sensor.name in sensors]
            scene = self._scene
            self._conditions[sensors] = condition_classes(scene.truth, scene.instants(), read, self._piece.runs)
        return self._conditions[sensors]

    def _where_due(self, shape: tuple[int, int]) -> tuple[Mask, Mask]:
        """``(instants, objects, runs)`` where estimates count, and the first second after a detection.

        The same for all trackers, so that what one does not read is no excuse. A detection without a position does not
        make an estimate due, unless no sensor measures one.

        An object that was out of view for long counts as a new one: from when it is detected again.
        """
        runs, scene = self._piece.runs, self._scene
        seen = [(sensor, of_runs(sensor.in_view, runs)) for sensor in scene.sensors]
        lost = out_of_view(scene.truth.time, scene.instants(), seen) > self._work.lost_after
        last_lost = np.maximum.accumulate(np.where(lost, self._time[:, None, None], -np.inf), axis=0)
        latest = {name: _latest(valid[self._order[name]]) for name, valid in self._valid.items()}
        before = self._arrived(last_lost)

        def since(numbers: Mapping[str, Indices]) -> Mask:
            """Whether one of the first so many scans of a sensor, by instant, detected an object that was lost."""
            detected = np.zeros((len(self._time), *shape), dtype=bool)
            for name in self._placing:
                detected |= latest[name][numbers[name]] > before[name].astype(latest[name].dtype)
            return detected

        seen_for = {age: since(self._arrived(self._time - age)) for age in {self._work.settle, FIRST} - {0.0}}
        seen_for[0.0] = since(self._delivered())
        in_view = self._alive[:, :, None] & ~lost
        return in_view & seen_for[self._work.settle], in_view & seen_for[0.0] & ~seen_for[FIRST]

    def _delivered(self) -> dict[str, Indices]:
        """By sensor ``(instants,)`` how many of its scans a tracker can have been given."""
        number = {name: np.zeros(len(self._time), dtype=np.intp) for name in self._valid}
        for instant, group in enumerate(deliveries(self.scans, each_measurement=self._scene.each_measurement)):
            for delivery in group:
                if delivery.number is not None:
                    number[delivery.scan.sensor][instant] += 1
        return {name: np.cumsum(of_sensor) for name, of_sensor in number.items()}

    def _arrived(self, until: Array) -> dict[str, Indices]:
        """By sensor, how many of its scans had arrived by some times."""
        arrival = {name: self._arrival[name][order] for name, order in self._order.items()}
        return {name: np.searchsorted(times, until + SAME_TIME, side="right") for name, times in arrival.items()}

    def _reference(self, sensors: frozenset[str], start: BoundStart) -> Array:
        """Zero before anything is known, where no estimate is scored."""
        scene, work = self._scene, self._work
        if scene.point != "centre":
            # The bound is of the point that is measured.
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


def _latest(valid: Mask) -> Indices:
    """``(scans + 1, objects, runs)`` of the first so many scans the number of the latest that detected an object, from
    1; 0: none did."""
    kind = np.min_scalar_type(-len(valid) - 1)
    latest = np.zeros((len(valid) + 1, *valid.shape[1:]), dtype=kind)
    for number, detected in enumerate(valid, 1):
        np.maximum(latest[number - 1], detected * kind.type(number), out=latest[number])
    return latest


def _position(scans: Sequence[Scan], placing: Collection[str], number: int) -> Array:
    """``(2, batch)`` m that a scan states; where no sensor measures a position, that of the sensor."""
    scan = scans[number]
    if scan.sensor in placing and not SENSOR_MODELS[scan.kind].measures_position():
        return np.broadcast_to(scan.sensor_pose[:2, None], (2, scan.valid.size))
    return SENSOR_MODELS[scan.kind].position(scan).mean


def _start(tracker: TrackerEntry, velocity_sigma: float) -> BoundStart:
    if isinstance(tracker, FilterConfig) and tracker.initial.source == "truth":
        return BoundStart(tracker.initial.velocity_sigma_mps, tracker.initial.position_sigma_m)
    return BoundStart(velocity_sigma)

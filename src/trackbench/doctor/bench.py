"""The tracker on the table: brought to every station, and asked there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trackbench import linalg
from trackbench.doctor.drives import Course
from trackbench.doctor.following import Track
from trackbench.doctor.session import Answer, Broken, Session, blind
from trackbench.doctor.stations import Station, Stations
from trackbench.doctor.vitals import Vitals
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.trackers.base import Tracker
from trackbench.types import Array, Mask, Scan

#: How long a target is followed before the tracker is asked, s.
WARM_UP = 3.0
#: Change of a measurement by which a gain is measured, in its standard deviations.
NUDGE = 0.05
#: A gain below this, relative to the largest, is no gain.
NO_GAIN = 1e-6


class Bench:
    """Follows targets to stations with a fresh tracker each."""

    def __init__(
        self,
        make: Callable[[], Tracker],
        sensors: Mapping[str, Sensor],
        courses: Sequence[tuple[Course, Track]],
        stations: Stations,
        seed: int,
    ) -> None:
        self.make = make
        self.sensors = sensors
        self.courses = courses
        """The drives, each with the reference's track."""
        self.stations = stations
        self.seed = seed
        """Of the noise."""
        self.vitals = Vitals()
        self.broken: list[tuple[str, Broken]] = []
        self._sessions: dict[tuple[Station, tuple[str, ...]], Session | None] = {}

    def kinds(self) -> list[tuple[str, ...]]:
        """Which sensors a target is followed with: each alone, and all."""
        alone: list[tuple[str, ...]] = [(name,) for name in self.sensors]
        return alone if len(alone) == 1 else [*alone, tuple(self.sensors)]

    def followed(self, station: Station, sensors: tuple[str, ...]) -> Session | None:
        """A tracker that has followed the target without noise up to just before time 0; None if it broke."""
        key = (station, sensors)
        if key not in self._sessions:
            self._sessions[key] = self._follow(station, sensors)
        return self._sessions[key]

    def _follow(self, station: Station, sensors: tuple[str, ...]) -> Session | None:
        session = Session(self.make)
        for scan in approach(station, {name: self.sensors[name] for name in sensors}):
            try:
                answer = session.step(scan)
            except Broken as broken:
                self.broken.append((station.name, broken))
                return None
            self.vitals.note(answer, scan, station.name)
        return session

    @cached_property
    def replies(self) -> dict[str, list[Reply]]:
        """By sensor, what was asked at the stations of ordinary geometry."""
        found: dict[str, list[Reply]] = {name: [] for name in self.sensors}
        for station in self.stations.ordinary:
            for by in self.kinds():
                for name in self.sensors:
                    reply = self.reply(station, name, by)
                    if reply is not None and reply.sound:
                        found[name].append(reply)
        return found

    @cached_property
    def memoryless(self) -> bool:
        """Whether the tracker takes each position that is read as it is, and so predicts and weighs nothing."""
        for reply in (reply for replies in self.replies.values() for reply in replies):
            later = reply.session.peek(blind(reply.scan._replace(time=reply.scan.time + 1.0)))
            if later is None or not np.allclose(later.mean[:2], reply.predicted.mean[:2]):
                return False
            aside = 5.0 * np.array([reply.spread[0], -reply.spread[1], 0.0, 0.0])
            scan = reply.scan
            measurement = SENSOR_MODELS[scan.kind].measure(
                reply.predicted.mean + aside, scan.sensor_pose, scan.sensor_velocity
            )
            answer = reply.ask(measurement)
            wanted = (reply.predicted.mean + aside)[:2]
            if answer is None or np.hypot(*(answer.mean[:2] - wanted)) > 5e-3 * np.hypot(*aside[:2]):
                return False
        return any(self.replies.values())

    def reply(self, station: Station, sensor: str, by: tuple[str, ...]) -> Reply | None:
        """What is asked about one sensor at a station; None where the tracker broke or has no estimate."""
        session = self.followed(station, by)
        if session is None:
            return None
        scan = station.scan(sensor, self.sensors[sensor], 0.0)
        try:
            predicted = session.peek(blind(scan))
        except Broken as broken:
            self.broken.append((station.name, broken))
            return None
        if predicted is None:
            return None
        return Reply(station, by, scan, predicted, session)


def approach(station: Station, sensors: Mapping[str, Sensor]) -> list[Scan]:
    """The scans before time 0, those of one instant in the order of the sensors."""
    scans = []
    for name, sensor in sensors.items():
        rate = min(sensor.rate_hz, 20.0)
        scans += [station.scan(name, sensor, k / rate) for k in range(-int(WARM_UP * rate), 0)]
    return sorted(scans, key=lambda scan: scan.time)


@dataclass(frozen=True, eq=False)
class Reply:
    """A tracker just before a measurement, which can be asked what it would make of any measurement."""

    station: Station
    by: tuple[str, ...]
    """The sensors with which the target was followed."""
    scan: Scan
    """What the sensor would read of the true target, without noise."""
    predicted: Answer
    session: Session
    _effects: dict[tuple[float, ...], Effect | None] = field(default_factory=dict)

    @property
    def sensor(self) -> str:
        return self.scan.sensor

    @property
    def sound(self) -> bool:
        """Whether the prediction is something that can be reasoned about."""
        p = self.predicted
        return p.finite and bool(np.abs(p.mean).max() < 1e4) and bool(np.diag(p.covariance).min() > 0.0)

    @cached_property
    def sigma(self) -> Array:
        """``(m,)`` stated standard deviations of the measurement."""
        return np.sqrt(np.diag(self.scan.noise_covariance))

    @cached_property
    def spread(self) -> Array:
        """``(4,)`` standard deviations of the prediction: the scale of the state."""
        return np.sqrt(np.diag(self.predicted.covariance))

    @cached_property
    def expected(self) -> Array:
        """``(m,)`` the measurement that the predicted mean should lead to expect."""
        return SENSOR_MODELS[self.scan.kind].measure(
            self.predicted.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def jacobian(self) -> Array:
        """``(m, 4)`` derivative of the measurement at the predicted mean."""
        return SENSOR_MODELS[self.scan.kind].jacobian(
            self.predicted.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def curvature(self) -> Array:
        """``(m,)`` standard deviation of the measurement's second order over the prediction, relative to its own.

        ``sqrt(tr(A P A P) / 2)`` with the second derivative ``A`` (Bar-Shalom, Li and Kirubarajan 2001, section
        10.3.2). Where it is large, sigma points and a linearisation differ, and neither is wrong.
        """
        model, scan = SENSOR_MODELS[self.scan.kind], self.scan
        steps = np.diag(1e-3 * np.maximum(self.spread, 1e-3))
        ahead, behind = (
            [
                model.jacobian(self.predicted.mean + side * step, scan.sensor_pose, scan.sensor_velocity)
                for step in steps
            ]
            for side in (1, -1)
        )
        second = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * np.diag(steps))
        bent = np.einsum("iab,bc->iac", second, linalg.symmetrise(self.predicted.covariance))
        return np.asarray(np.sqrt(np.maximum(np.einsum("iab,iba->i", bent, bent), 0.0) / 2) / self.sigma)

    def ask(self, measurement: Array) -> Answer | None:
        """What the tracker would say if the sensor read this; None where it cannot say."""
        try:
            answer = self.session.peek(self.scan._replace(measurement=np.asarray(measurement, dtype=float)))
        except Broken:
            return None
        return answer if answer is not None and answer.finite else None

    def effect(self, measurement: Array) -> Effect | None:
        """What a measurement does to the estimate; None where the tracker cannot say."""
        key = tuple(float(value) for value in measurement)
        if key not in self._effects:
            self._effects[key] = self._measured(np.array(key))
        return self._effects[key]

    def _measured(self, at: Array) -> Effect | None:
        centre = self.ask(at)
        if centre is None:
            return None
        columns = []
        for i, step in enumerate(NUDGE * self.sigma):
            slopes = []
            for nudge in (step, -step):
                nudged = at.copy()
                nudged[i] += nudge
                answer = self.ask(nudged)
                if answer is None:
                    return None
                slopes.append((answer.mean - centre.mean) / nudge)
            # An angle may jump on one side.
            columns.append(min(slopes, key=lambda slope: float(np.abs(slope).max())))
        return Effect(centre, np.stack(columns, axis=1), self)


@dataclass(frozen=True, eq=False)
class Effect:
    """What a measurement does to the estimate."""

    answer: Answer
    gain: Array
    """``(4, m)`` by finite differences of the measurement."""
    reply: Reply

    @cached_property
    def relative_gain(self) -> Array:
        """``(4, m)`` the gain in standard deviations of the prediction for one of the measurement."""
        return self.gain * self.reply.sigma / self.reply.spread[:, None]

    @cached_property
    def used(self) -> Mask:
        """``(m,)`` which components of the measurement move the estimate."""
        size = np.linalg.norm(self.relative_gain, axis=0)
        return np.asarray(size > NO_GAIN * max(1.0, float(size.max())))

    @cached_property
    def surprise(self) -> Array:
        """``(m,)`` the innovation that explains how far the estimate moved, in standard deviations of the measurement.

        NaN in components that move nothing.
        """
        moved = (self.answer.mean - self.reply.predicted.mean) / self.reply.spread
        found = np.full(len(self.used), np.nan)
        if self.used.any():
            found[self.used] = np.linalg.pinv(self.relative_gain[:, self.used], rcond=1e-9) @ moved
        return found

    @cached_property
    def information(self) -> Array | None:
        """``(4, m)`` ``P^-1 K``, which of a Kalman filter is ``H^T R^-1``; None where P is not positive definite."""
        p = linalg.symmetrise(self.answer.covariance)
        if not np.linalg.eigvalsh(p)[0] > 0.0:
            return None
        return np.asarray(np.linalg.solve(p, self.gain))

"""Scans of objects that move straight and steadily about a sensor at rest, and what a tracker makes of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, FieldOfView, Scan, Tracks
from trackbench.driving.tracks import TracksStepper, tracks_of_run
from trackbench.models.sensors import Sensor
from trackbench.subjects.doctor.findings import CheckResult, Finding, PartResult

#: Of the sensor, Hz; its range, m; and what it states: detection probability, false alarms a scan.
RATE, RANGE, DETECTION, FALSE_ALARMS = 20.0, 150.0, 0.9, 2.0
#: px, py m, vx, vy m/s, far from each other.
OBJECTS = np.array([[60.0, 30, -8, 2], [-50, 40, 6, -3], [20, -60, 1, 9]]).T
#: A track this near to an object is on it, m.
NEAR = 5.0


Make = Callable[[], TracksStepper]


class Expected(NamedTuple):
    """What a track expects of its next measurement."""

    mean: Array
    """``(m,)``"""
    covariance: Array
    """``(m, m)`` with the noise."""
    gain: Array
    """``(4, m)`` of a Kalman filter."""


@dataclass(frozen=True)
class Site:
    """A sensor at rest, at the origin."""

    name: str
    sensor: Sensor

    @property
    def clutter_density(self) -> float:
        """That it states."""
        return FALSE_ALARMS / self.sensor.model_copy(update={"max_range_m": RANGE, "fov_deg": 360.0}).volume()

    @property
    def sensor_size(self) -> int:
        """Components of a measurement."""
        return len(self.sensor.components)

    def scan(self, time: float, detections: Array, random: np.random.Generator) -> Scan:
        """Detections ``(m, D)`` in a random order."""
        order = random.permutation(detections.shape[1])
        return Scan(
            time=time,
            sensor=self.name,
            kind=self.sensor.type,
            measurement=detections[:, order],
            valid=np.ones(len(order), dtype=bool),
            noise_covariance=self.sensor.noise_covariance(),
            sensor_pose=np.zeros(3),
            sensor_velocity=np.zeros(2),
            arrival_time=time,
            detection_probability=DETECTION,
            clutter_density=self.clutter_density,
            field_of_view=FieldOfView(np.pi, RANGE),
        )

    @property
    def spread(self) -> float:
        """Largest standard deviation of a position that a detection at 40 m states, m."""
        one = self.scan(
            0.0,
            self.sensor.measure(np.array([[40.0], [10], [0], [0]]), np.zeros(3), np.zeros(2)),
            np.random.default_rng(0),
        )
        return float(np.sqrt(np.linalg.eigvalsh(self.sensor.position(one).covariance.reshape(2, 2)).max()))

    def exact(self, objects: Array, seconds: float) -> list[Scan]:
        """Every object detected in every scan, without noise."""
        times, random = np.arange(round(seconds * RATE)) / RATE, np.random.default_rng(0)
        ideal = (self.sensor.measure(moved(objects, float(t)), np.zeros(3), np.zeros(2)) for t in times)
        return [self.scan(float(t), one, random) for t, one in zip(times, ideal, strict=True)]

    def expected(self, tracks: Tracks, column: int) -> Expected:
        """What a track expects to be measured, at the time that it is told for."""
        mean, pose, velocity = tracks.mean[:, column], np.zeros(3), np.zeros(2)
        slope, prior = self.sensor.jacobian(mean, pose, velocity), tracks.covariance[:, :, column]
        covariance = slope @ prior @ slope.T + self.sensor.noise_covariance()
        gain = np.asarray(np.linalg.solve(covariance, slope @ prior).T, dtype=float)
        return Expected(self.sensor.measure(mean, pose, velocity), covariance, gain)

    def detections(self, objects: Array, time: float, random: np.random.Generator) -> Array:
        """``(m, n)`` noisy measurements of objects ``(4, n)`` that were there at time 0."""
        ideal = self.sensor.measure(moved(objects, time), np.zeros(3), np.zeros(2))
        return ideal + np.array(self.sensor.sigmas())[:, None] * random.standard_normal(ideal.shape)

    def scans(self, objects: Array, start: float, seconds: float, random: np.random.Generator) -> list[Scan]:
        """Every object detected in every scan."""
        times = start + np.arange(round(seconds * RATE)) / RATE
        return [self.scan(float(t), self.detections(objects, float(t), random), random) for t in times]

    def none(self, start: float, seconds: float, random: np.random.Generator) -> list[Scan]:
        """Empty scans."""
        return self.scans(OBJECTS[:, :0], start, seconds, random)


class Follower:
    """A tracker on its way through scans."""

    def __init__(self, make: Make) -> None:
        self._tracker = make()

    def step(self, scan: Scan) -> Tracks:
        """What it says after a scan."""
        one = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
        return tracks_of_run(self._tracker.step(one), 0)

    def follow(self, scans: Sequence[Scan]) -> list[Tracks]:
        """What it says after each scan."""
        return [self.step(scan) for scan in scans]


def nearest(tracks: Tracks, position: Array) -> int | None:
    """The column of the track that is on an object at ``(2,)``; None: there is none."""
    away = distances(tracks, position[:2, None])[:, 0]
    return int(np.argmin(away)) if len(away) and away.min() < NEAR else None


def moved(objects: Array, time: float) -> Array:
    """Objects ``(4, ...)`` some time later."""
    return np.concatenate([objects[:2] + objects[2:] * time, objects[2:]])


def distances(tracks: Tracks, positions: Array) -> Array:
    """``(K, n)`` m, of tracks to positions ``(2, n)``."""
    away = tracks.mean[:2, :, None] - positions[:2, None, :]
    return np.asarray(np.hypot(away[0], away[1]))


def note(result: PartResult, name: str, passed: bool, text: str, fault: str, question: str = "") -> None:
    """Add a check, and its finding where it failed; a question that is not given is that of the check's record."""
    result.checks.append(CheckResult(name, question, bool(passed), text))
    if not passed:
        result.findings.append(Finding(fault, 0.9, text[0].upper() + text[1:] + "."))

"""Places at which a tracker is asked what it expects: each isolates one geometry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.sensing.geometry import sensor_motion
from trackbench.types import Array, Observer, Scan


class Carrier(NamedTuple):
    """The observer at the time of the question."""

    x: float = 0.0
    """m"""
    y: float = 0.0
    """m"""
    yaw: float = 0.0
    """rad"""
    vx: float = 0.0
    """m/s"""
    vy: float = 0.0
    """m/s"""


class Station(NamedTuple):
    """A target in straight and steady motion, and where it is when the tracker is asked."""

    name: str
    purpose: str
    target: tuple[float, float, float, float]
    """px, py, vx, vy in the fixed frame, at time 0; before it the time is negative."""
    carrier: Carrier = Carrier()

    def truth(self, time: float) -> Array:
        """``(4,)`` the target at a time."""
        px, py, vx, vy = self.target
        return np.array([px + vx * time, py + vy * time, vx, vy])

    def turned(self, angle: float) -> Station:
        """The target turned about the origin, rad."""
        c, s = np.cos(angle), np.sin(angle)
        px, py, vx, vy = self.target
        target = (c * px - s * py, s * px + c * py, c * vx - s * vy, s * vx + c * vy)
        return self._replace(name=f"{self.name}_turned", target=target)

    def scan(self, name: str, sensor: Sensor, time: float, target: Array | None = None) -> Scan:
        """What a sensor reads without noise, of where the target is or would be."""
        of = self.carrier
        one = np.ones(1)
        observer = Observer(
            (of.x + of.vx * time) * one, (of.y + of.vy * time) * one, of.yaw * one, of.vx * one, of.vy * one, 0.0 * one
        )
        motion = sensor_motion(observer, sensor.mount)
        pose, velocity = motion.pose[:, 0], motion.velocity[:, 0]
        seen = self.truth(time) if target is None else target
        measurement = SENSOR_MODELS[sensor.type].measure(seen, pose, velocity)
        return Scan(
            time, name, sensor.type, measurement, np.array(True), sensor.noise_covariance(), pose, velocity, time
        )


OPEN = (
    Station("ahead_left", "a target ahead to the left", (18.0, 13.0, -4.0, 9.0)),
    Station("behind_left", "a target behind to the left", (-20.0, 12.0, 7.0, 6.0)),
    Station("behind_right", "a target behind to the right", (-15.0, -18.0, -9.0, 3.0)),
    Station("ahead_right", "a target ahead to the right", (22.0, -12.0, 5.0, -8.0)),
    Station("close_pass", "a fast target close by", (6.0, 9.0, 14.0, -5.0)),
)
RADIAL = Station("radial", "a target that comes straight at the sensor", (30.0, 17.0, -12.0, -6.8))
TANGENTIAL = Station("tangential", "a target that passes across the line of sight", (9.0, 12.0, 8.0, -6.0))
MOVING = (
    Station(
        "moving_ahead",
        "an observer that drives and looks aside",
        (35.0, 10.0, 3.0, 7.0),
        Carrier(12.0, -9.0, 0.7, 9.0, 4.0),
    ),
    Station(
        "moving_behind",
        "a target behind an observer that drives",
        (-18.0, 16.0, 6.0, -5.0),
        Carrier(9.0, 20.0, -0.9, -7.0, 8.0),
    ),
)
PASSING = (
    Station("oncoming", "oncoming traffic alongside", (1.0, 11.0, -13.0, 0.0), Carrier(vx=14.0)),
    Station("crossing", "crossing traffic close ahead", (9.0, -2.0, 2.0, 16.0)),
)
#: Where the azimuth is pi: so close that a prediction's own spread reaches across, and so that only measurements do.
AXES = (
    Station("azimuth_axis", "a target that crosses the azimuth of pi", (-25.0, 0.05, 2.0, -7.0)),
    Station("azimuth_axis_near", "a target about to cross the azimuth of pi", (-25.0, 0.3, 2.0, -7.0)),
)
COURSE_AXIS = Station("course_axis", "a target whose course is pi", (20.0, -15.0, -9.0, 0.002))
STATIONARY = Station("at_rest", "a target at rest", (17.0, 11.0, 0.0, 0.0))
AT_SENSOR = Station("at_sensor", "a target at the sensor itself", (0.0, 0.0, 0.0, 0.0))


class Stations(NamedTuple):
    """All of them."""

    open: tuple[Station, ...] = OPEN
    radial: Station = RADIAL
    tangential: Station = TANGENTIAL
    passing: tuple[Station, ...] = PASSING
    moving: tuple[Station, ...] = MOVING
    axes: tuple[Station, ...] = AXES
    course_axis: Station = COURSE_AXIS
    at_rest: Station = STATIONARY
    at_sensor: Station = AT_SENSOR

    @property
    def ordinary(self) -> tuple[Station, ...]:
        """Those at which no angle is at its limit and nothing stands still."""
        return (*self.open, self.radial, self.tangential, *self.passing, *self.moving)


def varied(random: np.random.Generator) -> Stations:
    """The stations with other targets: positions and velocities a tenth larger or smaller where it does not matter."""

    def other(station: Station) -> Station:
        place, pace = random.uniform(0.9, 1.1, 2)
        px, py, vx, vy = station.target
        return station._replace(target=(place * px, place * py, pace * vx, pace * vy))

    def others(stations: tuple[Station, ...]) -> tuple[Station, ...]:
        return tuple(other(station) for station in stations)

    return Stations(others(OPEN), other(RADIAL), other(TANGENTIAL), others(PASSING), others(MOVING))

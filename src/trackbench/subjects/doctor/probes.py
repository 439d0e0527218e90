"""Where the sensors of an examination are, and the targets at which single measurements are tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Observer, Scan
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS, Mount, Sensor
from trackbench.sensing.view import sensor_motion


class Carrier(NamedTuple):
    """The observer at time 0; its velocity and its turn rate are constant."""

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
    yaw_rate: float = 0.0
    """rad/s"""

    @property
    def moves(self) -> bool:
        """Whether it is not at rest."""
        return self.vx != 0.0 or self.vy != 0.0 or self.yaw_rate != 0.0

    def at_rest(self) -> Carrier:
        """The same one, standing."""
        return Carrier(self.x, self.y, self.yaw)


class SensorSite(NamedTuple):
    """A sensor on an observer, to whose frame the places of targets are relative."""

    standing: Carrier = Carrier()
    moving: Carrier | None = None
    """Instead of those of the moving probes and of the drive with a moving observer."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Forward m, left m, and yaw rad."""

    def carrier(self, own: Carrier) -> Carrier:
        """The one that carries the sensors in place of another."""
        return (self.moving or own) if own.moves else self.standing

    def target(self, state: Array, own: Carrier) -> Array:
        """``(4,)`` px, py, vx, vy that are to the sensor what ``state`` is to an observer of its own."""
        to = self.carrier(own)
        if to == own and not any(self.mount):
            return state
        relative = _turned(state - np.array([own.x, own.y, own.vx, own.vy]), -own.yaw)
        arm = np.array([*self.mount[:2], 0.0, 0.0])
        turned = _turned(arm + _turned(relative, self.mount[2]), to.yaw)
        return np.asarray(turned + np.array([to.x, to.y, to.vx, to.vy]))

    @property
    def yaw(self) -> float:
        """Of the sensor on the standing observer, rad."""
        return self.standing.yaw + self.mount[2]


def site_of(mount: Mount, observer: Carrier | None) -> SensorSite:
    """The site of a sensor on the user's observer; None for the bench's own ones."""
    own = (mount.x_m, mount.y_m, float(np.deg2rad(mount.yaw_deg)))
    if observer is None:
        return SensorSite(mount=own)
    return SensorSite(observer.at_rest(), observer if observer.moves else None, own)


def carrier_of(observer: Observer) -> Carrier:
    """An observer of a scenario: where it is fastest, and with the largest turn rate that it has."""
    at = int(np.argmax(np.hypot(observer.vx, observer.vy)))
    turn = observer.yaw_rate[int(np.argmax(np.abs(observer.yaw_rate)))]
    pose = (observer.px[at], observer.py[at], wrap_angle(observer.yaw[at]))
    return Carrier(*(float(value) for value in (*pose, observer.vx[at], observer.vy[at], turn)))


def _turned(state: Array, angle: float) -> Array:
    turn = rotation(angle)
    return np.concatenate([turn @ state[:2], turn @ state[2:]])


#: Least and largest rate of a sensor, Hz: at 5 Hz sound turning models lose targets at the sensor, and the second order
#: of sigma points has innovations; the truth of drives has 100 steps a second.
RATES = (10.0, 50.0)


def examination_rate(sensor: Sensor) -> float:
    """Its rate in an examination, Hz; where its measurements are recorded, 10 of a lidar and 20 of a radar."""
    return float(np.clip(sensor.rate_hz or (10.0 if sensor.type == "lidar" else 20.0), *RATES))


def simplified(sensor: Sensor) -> Sensor:
    """The sensor without limits of view, missed detections, delays and effects."""
    unlimited: dict[str, Any] = {"fov_deg": 360.0, "max_range_m": None, "detection_probability": 1.0, "dropouts": []}
    rate = {"rate_hz": examination_rate(sensor), "phase_s": 0.0, "latency_s": 0, "effects": []}
    return sensor.model_copy(update={**unlimited, **rate})


#: Angle by which a mounting is turned, rad: more than any azimuth is uncertain at the probes, and not so much that a
#: target behind the sensor is ahead of it.
MOUNTED_TURN = -0.6


def rotation(angle: float) -> Array:
    """``(2, 2)`` counter-clockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def turned_mounting(scan: Scan, angle: float) -> Scan:
    """The same target in the fixed frame, measured by a sensor that is mounted turned by ``-angle``."""
    pose, measurement, noise = scan.sensor_pose.copy(), scan.measurement.copy(), scan.noise_covariance
    pose[2] = wrap_angle(pose[2] - angle)
    angular = list(SENSOR_MODELS[scan.kind].angular)
    if angular:
        measurement[angular] = wrap_angle(measurement[angular] + angle)
    else:
        turn = rotation(angle)
        measurement, noise = turn @ measurement, turn @ noise @ turn.T
    return scan._replace(measurement=measurement, noise_covariance=noise, sensor_pose=pose)


class Probe(NamedTuple):
    """A target of constant speed, an observer of constant velocity; measurements are tried at time 0."""

    name: str
    description: str
    target: tuple[float, float, float, float]
    """px, py, vx, vy in the fixed frame at time 0."""
    observer: Carrier = Carrier()
    """Its yaw is constant in a probe."""
    turn_rate: float = 0.0
    """Of the target, rad/s."""

    def truth(self, time: float) -> Array:
        """``(4,)`` px, py, vx, vy of the target at a time."""
        px, py, vx, vy = self.target
        # The chord of an arc has the mean course, and is shorter than the path by sinc.
        half = 0.5 * self.turn_rate * time
        dx, dy = time * np.sinc(half / np.pi) * (rotation(half) @ [vx, vy])
        return np.array([px + dx, py + dy, *(rotation(2.0 * half) @ [vx, vy])])

    def turned(self, angle: float, sensor: Sensor) -> Probe:
        """The probe with its target turned about a sensor of the standing observer by an angle in rad."""
        c, s = np.cos(angle), np.sin(angle)
        x, y, _ = self.scan("", sensor, 0.0).sensor_pose
        px, py, vx, vy = self.target
        px, py = px - x, py - y
        target = (x + c * px - s * py, y + s * px + c * py, c * vx - s * vy, s * vx + c * vy)
        return self._replace(name=f"{self.name}_turned", target=_plain(target))

    def placed(self, site: SensorSite) -> Probe:
        """The probe at a site: its target has the same place and velocity relative to the sensor there."""
        target = site.target(np.array(self.target), self.observer)
        return self._replace(target=_plain(target), observer=site.carrier(self.observer))

    def standing(self) -> Probe:
        """The probe with its observer at rest and the same relative velocity."""
        px, py, vx, vy = self.target
        return self._replace(
            target=(px, py, vx - self.observer.vx, vy - self.observer.vy), observer=self.observer.at_rest()
        )

    def scan(self, name: str, sensor: Sensor, time: float) -> Scan:
        """A sensor's measurement of the target without noise."""
        # A tracker may write into what it is given.
        measurement, pose, velocity = (part.copy() for part in _measured(self, sensor.type, sensor.mount, time))
        return Scan(
            time, name, sensor.type, measurement, np.array(True), sensor.noise_covariance(), pose, velocity, time
        )


@lru_cache(maxsize=10_000)
def _measured(probe: Probe, kind: str, mount: Mount, time: float) -> tuple[Array, Array, Array]:
    """The measurement of a probe's target by a kind of sensor, and the pose and the velocity of that sensor."""
    of = probe.observer
    one = np.ones(1)
    observer = Observer(
        (of.x + of.vx * time) * one, (of.y + of.vy * time) * one, of.yaw * one, of.vx * one, of.vy * one, 0.0 * one
    )
    motion = sensor_motion(observer, mount)
    pose, velocity = motion.pose[:, 0], motion.velocity[:, 0]
    return SENSOR_MODELS[kind].measure(probe.truth(time), pose, velocity), pose, velocity


def _plain(state: Iterable[float]) -> tuple[float, float, float, float]:
    px, py, vx, vy = (float(value) for value in state)
    return px, py, vx, vy


def with_measurement_noise(scan: Scan, random: np.random.Generator) -> Scan:
    """The scan with measurement noise of its stated variances."""
    noise = np.sqrt(np.diag(scan.noise_covariance)) * random.standard_normal(len(scan.measurement))
    return scan._replace(measurement=scan.measurement + noise)


def probe_rate(sensor: Sensor) -> float:
    """Scans of a sensor per second at a probe, Hz."""
    return sensor.rate_hz or 20.0


GENERAL = (
    Probe("ahead_left", "a target ahead to the left", (18.0, 13.0, -4.0, 9.0)),
    Probe("behind_left", "a target behind to the left", (-20.0, 12.0, 7.0, 6.0)),
    Probe("behind_right", "a target behind to the right", (-15.0, -18.0, -9.0, 3.0)),
    Probe("ahead_right", "a target ahead to the right", (22.0, -12.0, 5.0, -8.0)),
    Probe("close_pass", "a fast target close to the sensor", (6.0, 9.0, 14.0, -5.0)),
)
RADIAL = Probe("radial", "a target moving straight towards the sensor", (30.0, 17.0, -12.0, -6.8))
TANGENTIAL = Probe("tangential", "a target moving across the line of sight", (9.0, 12.0, 8.0, -6.0))
MOVING = (
    Probe(
        "moving_ahead",
        "a target ahead of a moving, turned observer",
        (35.0, 10.0, 3.0, 7.0),
        Carrier(12.0, -9.0, 0.7, 9.0, 4.0),
    ),
    Probe(
        "moving_behind",
        "a target behind a moving, turned observer",
        (-18.0, 16.0, 6.0, -5.0),
        Carrier(9.0, 20.0, -0.9, -7.0, 8.0),
    ),
)
PASSING = (
    Probe("oncoming", "oncoming traffic in the next lane", (1.0, 11.0, -13.0, 0.0), Carrier(vx=14.0)),
    Probe("crossing", "crossing traffic close ahead", (9.0, -2.0, 2.0, 16.0)),
)
#: At an azimuth of pi: the prediction's own sigma points, narrow or wide, cross it in the first, and only the
#: measurements in the second.
AXES = (
    Probe("azimuth_axis", "a target at the azimuth pi", (-25.0, 1e-4, 2.0, -7.0)),
    Probe("azimuth_axis_near", "a target just before the azimuth pi", (-25.0, 0.3, 2.0, -7.0)),
)
#: Its course goes from 0.8 rad, at -5 s, to pi at -0.5 s. It starts ahead and moves away: of a tracker that starts with
#: the course 0 the speed becomes positive, so that its own course passes pi.
COURSE_TURN = Probe(
    "course_turn",
    "a target that turns through the course pi at 30 degrees/s",
    (10.4, 50.8, -8.693, -2.329),
    turn_rate=np.deg2rad(30.0),
)
AT_REST = Probe("at_rest", "a target at rest", (17.0, 11.0, 0.0, 0.0))


class Probes(NamedTuple):
    """All probes of an examination."""

    general: tuple[Probe, ...] = GENERAL
    radial: Probe = RADIAL
    tangential: Probe = TANGENTIAL
    passing: tuple[Probe, ...] = PASSING
    moving: tuple[Probe, ...] = MOVING
    axes: tuple[Probe, ...] = AXES
    course_turn: Probe = COURSE_TURN
    at_rest: Probe = AT_REST
    site: SensorSite = SensorSite()

    def standing(self) -> Probes:
        """The probes without a moving observer."""
        return self._replace(moving=(), passing=tuple(probe.standing() for probe in self.passing))

    def placed(self, sites: Sequence[SensorSite]) -> Probes:
        """The probes at the site of the first sensor, and those with an azimuth of pi at the site of each."""
        site = sites[0]

        def all_placed(probes: Sequence[Probe]) -> tuple[Probe, ...]:
            return tuple(probe.placed(site) for probe in probes)

        return Probes(
            all_placed(self.general),
            self.radial.placed(site),
            self.tangential.placed(site),
            all_placed(self.passing),
            all_placed(self.moving),
            tuple(dict.fromkeys(probe.placed(one) for one in sites for probe in self.axes)),
            self.course_turn.placed(site),
            self.at_rest.placed(site),
            site,
        )

    @property
    def regular(self) -> tuple[Probe, ...]:
        """Those with no angle near pi, a range well above zero and a moving target."""
        return (*self.general, self.radial, self.tangential, *self.passing, *self.moving)


def varied(random: np.random.Generator) -> Probes:
    """The probes with positions and velocities scaled by 0.9 to 1.1, except where they must be exact."""

    def scaled(probe: Probe) -> Probe:
        position, velocity = random.uniform(0.9, 1.1, 2)
        px, py, vx, vy = probe.target
        return probe._replace(target=(position * px, position * py, velocity * vx, velocity * vy))

    def all_scaled(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
        return tuple(scaled(probe) for probe in probes)

    return Probes(all_scaled(GENERAL), scaled(RADIAL), scaled(TANGENTIAL), all_scaled(PASSING), all_scaled(MOVING))

"""Sites of the sensors in an examination, and probes: targets at which single measurements are tried."""

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
    """Pose and motion, at time 0, of an observer with constant velocity and turn rate."""

    x: float = 0.0
    """Position along the fixed x axis, m."""
    y: float = 0.0
    """Position along the fixed y axis, m."""
    yaw: float = 0.0
    """Heading, rad, counter-clockwise from the fixed x axis."""
    vx: float = 0.0
    """Velocity along the fixed x axis, m/s."""
    vy: float = 0.0
    """Velocity along the fixed y axis, m/s."""
    yaw_rate: float = 0.0
    """Turn rate, rad/s, counter-clockwise."""

    @property
    def moves(self) -> bool:
        return self.vx != 0.0 or self.vy != 0.0 or self.yaw_rate != 0.0

    def at_rest(self) -> Carrier:
        return Carrier(self.x, self.y, self.yaw)


class SensorSite(NamedTuple):
    """Observers that carry a sensor, and its mounting on them. Targets are placed relative to the sensor."""

    standing: Carrier = Carrier()
    moving: Carrier | None = None
    """Observer that replaces every moving observer of probes and drives; None keeps their own ones."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the sensor relative to the observer: forward, m; left, m; yaw, rad."""

    def carrier(self, observer: Carrier) -> Carrier:
        """Return the observer that carries the sensor, in place of the ``observer`` of a probe or test drive."""
        return (self.moving or observer) if observer.moves else self.standing

    def target(self, state: Array, observer: Carrier) -> Array:
        """Return the target ``(4,)`` that is to the sensor, in place and velocity, as ``state`` is to ``observer``."""
        carrier = self.carrier(observer)
        if carrier == observer and not any(self.mount):
            return state
        relative = _turned(state - np.array([observer.x, observer.y, observer.vx, observer.vy]), -observer.yaw)
        arm = np.array([*self.mount[:2], 0.0, 0.0])
        turned = _turned(arm + _turned(relative, self.mount[2]), carrier.yaw)
        return np.asarray(turned + np.array([carrier.x, carrier.y, carrier.vx, carrier.vy]))

    @property
    def yaw(self) -> float:
        """Yaw of the sensor on the standing observer, rad, counter-clockwise from the fixed x axis."""
        return self.standing.yaw + self.mount[2]


def site_of(mount: Mount, observer: Carrier | None) -> SensorSite:
    """Return the site of a sensor on the user's observer; None puts the sensor on the probes' own observers."""
    mount_pose = (mount.x_m, mount.y_m, float(np.deg2rad(mount.yaw_deg)))
    if observer is None:
        return SensorSite(mount=mount_pose)
    return SensorSite(observer.at_rest(), observer if observer.moves else None, mount_pose)


def carrier_of(observer: Observer) -> Carrier:
    """Return a scenario's observer at its greatest speed, but with the fastest turn rate of all instants."""
    fastest = int(np.argmax(np.hypot(observer.vx, observer.vy)))
    turn_rate = observer.yaw_rate[int(np.argmax(np.abs(observer.yaw_rate)))]
    pose = (observer.px[fastest], observer.py[fastest], wrap_angle(observer.yaw[fastest]))
    return Carrier(*(float(value) for value in (*pose, observer.vx[fastest], observer.vy[fastest], turn_rate)))


def _turned(state: Array, angle: float) -> Array:
    turn = rotation(angle)
    return np.concatenate([turn @ state[:2], turn @ state[2:]])


#: Least and largest rate of a sensor, Hz. At 5 Hz sound turning models lose targets near the sensor, and second-order
#: terms of sigma points look like innovations. The truth of drives has 100 steps a second.
RATES = (10.0, 50.0)


def examination_rate(sensor: Sensor) -> float:
    """Return a sensor's rate limited to 10 to 50 Hz; without a rate, 10 Hz for a lidar and 20 Hz for other sensors."""
    return float(np.clip(sensor.rate_hz or (10.0 if sensor.type == "lidar" else 20.0), *RATES))


def simplified(sensor: Sensor) -> Sensor:
    """Return the sensor at its examination rate, without limits of view, missed detections, delays and effects."""
    unlimited: dict[str, Any] = {"fov_deg": 360.0, "max_range_m": None, "detection_probability": 1.0, "dropouts": []}
    rate = {"rate_hz": examination_rate(sensor), "phase_s": 0.0, "latency_s": 0, "effects": []}
    return sensor.model_copy(update={**unlimited, **rate})


#: Angle by which a mounting is turned, rad: larger than the uncertainty of any azimuth at the probes, and so small that
#: a target behind the sensor stays behind it.
MOUNTED_TURN = -0.6


def rotation(angle: float) -> Array:
    """Return the matrix ``(2, 2)`` that rotates counter-clockwise by an angle, rad."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def turned_mounting(scan: Scan, angle: float) -> Scan:
    """Return the scan that the sensor makes of the same target when its mounting is turned by ``-angle``, rad."""
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
    """A test target of constant speed and an observer of constant velocity; measurements are tried at time 0."""

    name: str
    description: str
    target: tuple[float, float, float, float]
    """px, py, vx, vy in the fixed frame at time 0."""
    observer: Carrier = Carrier()
    """Observer at time 0; its turn rate is ignored."""
    turn_rate: float = 0.0
    """Turn rate of the target, rad/s, counter-clockwise."""

    def truth(self, time: float) -> Array:
        """Return px, py, vx, vy ``(4,)`` of the target at a time in s."""
        px, py, vx, vy = self.target
        # The chord of an arc has the mean course, and is shorter than the path by sinc.
        half = 0.5 * self.turn_rate * time
        dx, dy = time * np.sinc(half / np.pi) * (rotation(half) @ [vx, vy])
        return np.array([px + dx, py + dy, *(rotation(2.0 * half) @ [vx, vy])])

    def turned(self, angle: float, sensor: Sensor) -> Probe:
        """Return the probe, whose observer is at rest, with its target turned about a sensor by an angle, rad."""
        c, s = np.cos(angle), np.sin(angle)
        x, y, _ = self.scan("", sensor, 0.0).sensor_pose
        px, py, vx, vy = self.target
        px, py = px - x, py - y
        target = (x + c * px - s * py, y + s * px + c * py, c * vx - s * vy, s * vx + c * vy)
        return self._replace(name=f"{self.name}_turned", target=_as_floats(target))

    def placed(self, site: SensorSite) -> Probe:
        """Return the probe moved to a site; its target keeps place and velocity relative to the sensor."""
        target = site.target(np.array(self.target), self.observer)
        return self._replace(target=_as_floats(target), observer=site.carrier(self.observer))

    def standing(self) -> Probe:
        """Return the probe with its observer at rest; the target keeps its velocity relative to the observer."""
        px, py, vx, vy = self.target
        return self._replace(
            target=(px, py, vx - self.observer.vx, vy - self.observer.vy), observer=self.observer.at_rest()
        )

    def scan(self, name: str, sensor: Sensor, time: float) -> Scan:
        """Return a sensor's noise-free measurement of the target at a time in s."""
        # A tracker may write into the arrays of its scan.
        measurement, pose, velocity = (part.copy() for part in _measure(self, sensor.type, sensor.mount, time))
        return Scan(
            time, name, sensor.type, measurement, np.array(True), sensor.noise_covariance(), pose, velocity, time
        )


@lru_cache(maxsize=10_000)
def _measure(probe: Probe, kind: str, mount: Mount, time: float) -> tuple[Array, Array, Array]:
    """Return the noise-free measurement of a probe's target, and the sensor's pose ``(3,)`` and velocity ``(2,)``."""
    x, y, yaw, vx, vy, _ = (np.array([value]) for value in probe.observer)
    observer = Observer(x + vx * time, y + vy * time, yaw, vx, vy, np.zeros(1))
    motion = sensor_motion(observer, mount)
    pose, velocity = motion.pose[:, 0], motion.velocity[:, 0]
    return SENSOR_MODELS[kind].measure(probe.truth(time), pose, velocity), pose, velocity


def _as_floats(state: Iterable[float]) -> tuple[float, float, float, float]:
    px, py, vx, vy = (float(value) for value in state)
    return px, py, vx, vy


def with_measurement_noise(scan: Scan, random: np.random.Generator) -> Scan:
    """Return the scan with Gaussian noise of the stated variances added to its measurement."""
    noise = np.sqrt(np.diag(scan.noise_covariance)) * random.standard_normal(len(scan.measurement))
    return scan._replace(measurement=scan.measurement + noise)


def probe_rate(sensor: Sensor) -> float:
    """Return the rate at which a sensor measures a probe's target, Hz; 20 for a sensor without a rate."""
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
#: Targets at the azimuth pi. At the first, sigma points of the prediction cross pi, however narrow they are; at the
#: second, only measurements do.
AXES = (
    Probe("azimuth_axis", "a target at the azimuth pi", (-25.0, 1e-4, 2.0, -7.0)),
    Probe("azimuth_axis_near", "a target just before the azimuth pi", (-25.0, 0.3, 2.0, -7.0)),
)
#: A target whose course turns from 0.8 rad at -5 s to pi at -0.5 s. It starts ahead and moves away: a tracker that
#: starts with the course 0 then gets a positive speed, and its own course passes pi.
COURSE_TURN = Probe(
    "course_turn",
    "a target that turns through the course pi at 30 degrees/s",
    (10.4, 50.8, -8.693, -2.329),
    turn_rate=np.deg2rad(30.0),
)
AT_REST = Probe("at_rest", "a target at rest", (17.0, 11.0, 0.0, 0.0))


class Probes(NamedTuple):
    """Probes (test targets) of an examination, grouped by the motion of target and observer."""

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
        """Return the probes for sensors at rest: ``moving`` is left out, ``passing`` keeps its relative velocities."""
        return self._replace(moving=(), passing=tuple(probe.standing() for probe in self.passing))

    def placed(self, sites: Sequence[SensorSite]) -> Probes:
        """Return the probes moved to the first sensor's site; ``axes``, at the azimuth pi, are moved to every site."""
        site = sites[0]

        def all_placed(probes: Sequence[Probe]) -> tuple[Probe, ...]:
            return tuple(probe.placed(site) for probe in probes)

        return Probes(
            all_placed(self.general),
            self.radial.placed(site),
            self.tangential.placed(site),
            all_placed(self.passing),
            all_placed(self.moving),
            tuple(dict.fromkeys(probe.placed(sensor_site) for sensor_site in sites for probe in self.axes)),
            self.course_turn.placed(site),
            self.at_rest.placed(site),
            site,
        )

    @property
    def regular(self) -> tuple[Probe, ...]:
        """Probes with no angle near pi, a range well above zero and a moving target."""
        return (*self.general, self.radial, self.tangential, *self.passing, *self.moving)


def varied(random: np.random.Generator) -> Probes:
    """Scale target positions and velocities at random by 0.9 to 1.1; ``axes``, ``course_turn`` and ``at_rest`` stay."""

    def scaled(probe: Probe) -> Probe:
        position, velocity = random.uniform(0.9, 1.1, 2)
        px, py, vx, vy = probe.target
        return probe._replace(target=(position * px, position * py, velocity * vx, velocity * vy))

    def all_scaled(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
        return tuple(scaled(probe) for probe in probes)

    return Probes(all_scaled(GENERAL), scaled(RADIAL), scaled(TANGENTIAL), all_scaled(PASSING), all_scaled(MOVING))

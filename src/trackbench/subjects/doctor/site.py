"""The sensors of an examination: where they are, and what is left out of a scenario's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Observer
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import Mount, Sensor


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
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    return np.concatenate([turn @ state[:2], turn @ state[2:]])


#: Least and largest rate of a sensor, Hz: at 5 Hz sound turning models lose targets at the sensor, and the second order
#: of sigma points has innovations; the truth of drives has 100 steps a second.
RATES = (10.0, 50.0)


def examination_rate(sensor: Sensor) -> float:
    """Its rate in an examination, Hz; where its measurements are recorded, 10 of a lidar and 20 of a radar."""
    return float(np.clip(sensor.rate_hz or (10.0 if sensor.type == "lidar" else 20.0), *RATES))


def simplified(sensor: Sensor) -> Sensor:
    """The sensor without limits of view, missed detections, delays, biases and effects."""
    biases = {field: 0.0 for field in type(sensor).model_fields if "_bias_" in field}
    unlimited: dict[str, Any] = {"fov_deg": 360.0, "max_range_m": None, "detection_probability": 1.0, "dropouts": []}
    rate = {"rate_hz": examination_rate(sensor), "phase_s": 0.0, "latency_s": 0, "effects": []}
    return sensor.model_copy(update={**biases, **unlimited, **rate})

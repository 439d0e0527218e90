"""Wrong measurement models: what a tracker with a known fault predicts as the measurement of a target.

A measurement equal to the tracker's own prediction does not move the estimate. So the wrong model whose predictions do
not move it is the one that the tracker uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS

DEGREE = 180.0 / np.pi

Measure = Callable[[Array, Scan], Array]

#: Fault, description, and the azimuth that the wrong model gives for the right one.
AZIMUTHS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("arctan_quadrant", "azimuths behind the sensor are predicted ahead of it", lambda a: np.arctan(np.tan(a))),
    ("axis_mirrored", "the azimuth is measured clockwise", lambda a: -a),
    ("axis_mirrored", "the x axis points backward", lambda a: np.pi - a),
    ("axis_swapped", "the azimuth is measured from the y axis", lambda a: np.pi / 2 - a),
    ("degrees_for_radians", "the azimuth is predicted in degrees", lambda a: a * DEGREE),
    ("degrees_for_radians", "the azimuth in radians is converted to radians again", lambda a: a / DEGREE),
)


class WrongModel(NamedTuple):
    """A measurement model with one known fault."""

    fault: str
    description: str
    """What the tracker does."""
    measure: Measure
    """The predicted measurement ``(m,)`` of a target ``(4,)`` at a scan."""


def wrong_models(kind: str) -> list[WrongModel]:
    """The wrong models of a kind of sensor, simple ones first."""
    return [*(_lidar() if kind == "lidar" else _polar(kind)), *_posed()]


def _right(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _changed(change: Callable[[Array], Array]) -> Measure:
    return lambda target, scan: change(_right(target, scan))


def _azimuth(change: Callable[[float], float], fixed: bool = False) -> Measure:
    """The azimuth changed in the sensor's frame, or in the fixed frame before the yaw is subtracted."""

    def measure(target: Array, scan: Scan) -> Array:
        z, yaw = _right(target, scan).copy(), scan.sensor_pose[2] if fixed else 0.0
        z[1] = change(float(z[1] + yaw)) - yaw
        return z

    return measure


def _polar(kind: str) -> Iterator[WrongModel]:
    if kind == "radar":
        yield WrongModel("doppler_sign", "the range rate has the other sign", _changed(lambda z: z * [1, 1, -1]))
        for relative in (False, True):
            yield WrongModel("speed_for_range_rate", "the range rate is predicted as the speed", _speed(relative))
        yield WrongModel("ego_motion_ignored", "the range rate leaves out the sensor's own velocity", _at_rest)
    for fixed in (False, True):
        for fault, description, change in AZIMUTHS:
            yield WrongModel(fault, description, _azimuth(change, fixed))


def _lidar() -> Iterator[WrongModel]:
    yield WrongModel("axis_swapped", "x and y are swapped", _changed(lambda z: z[::-1]))
    yield WrongModel("axis_mirrored", "y has the other sign", _changed(lambda z: z * [1, -1]))
    yield WrongModel("axis_mirrored", "x has the other sign", _changed(lambda z: z * [-1, 1]))
    rotated = "x and y are swapped, and one has the other sign"
    yield WrongModel("axis_swapped", rotated, _changed(lambda z: z[::-1] * [1, -1]))
    yield WrongModel("axis_swapped", rotated, _changed(lambda z: z[::-1] * [-1, 1]))


def _posed() -> Iterator[WrongModel]:
    """Faults in the use of the sensor's pose and velocity."""
    still, standing = np.zeros(2), np.ones(2)
    for description, keep_pose, keep_velocity in (
        ("the sensor's pose is left out", (0, 0, 0), standing),
        ("the sensor's position is left out", (0, 0, 1), standing),
        ("the sensor's yaw is left out", (1, 1, 0), standing),
        ("the sensor's pose and velocity are left out", (0, 0, 0), still),
        ("the sensor's position and velocity are left out", (0, 0, 1), still),
        ("the sensor's yaw and velocity are left out", (1, 1, 0), still),
    ):
        yield WrongModel("ego_motion_ignored", description, _scaled(np.array(keep_pose, dtype=float), keep_velocity))
    for description, factor in (("in degrees", DEGREE), ("converted to radians twice", 1 / DEGREE)):
        yield WrongModel(
            "degrees_for_radians", f"the sensor's yaw is {description}", _scaled(np.array([1, 1, factor]), np.ones(2))
        )


def _scaled(pose: Array, velocity: Array) -> Measure:
    return lambda target, scan: SENSOR_MODELS[scan.kind].measure(
        target, scan.sensor_pose * pose, scan.sensor_velocity * velocity
    )


def _at_rest(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, np.zeros(2))


def _speed(relative: bool) -> Measure:
    def measure(target: Array, scan: Scan) -> Array:
        z = _right(target, scan).copy()
        z[2] = float(np.hypot(*(target[2:] - (scan.sensor_velocity if relative else 0.0))))
        return z

    return measure

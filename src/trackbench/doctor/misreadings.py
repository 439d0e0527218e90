"""Measurements that a tracker with a certain fault expects, of the target that it believes in.

A tracker whose own expectation is met does not move its estimate: so each fault of the measurement model can be told by
the measurement that meets it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array, Scan

DEGREE = 180.0 / np.pi

Expect = Callable[[Array, Scan], Array]

#: What becomes of an azimuth.
AZIMUTHS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("arctan_quadrant", "azimuths behind are taken for those ahead", lambda a: np.arctan(np.tan(a))),
    ("axis_mirrored", "the azimuth counts clockwise", lambda a: -a),
    ("axis_mirrored", "the x axis points backward", lambda a: np.pi - a),
    ("axis_swapped", "the azimuth is counted from the y axis", lambda a: np.pi / 2 - a),
    ("degrees_for_radians", "an azimuth in degrees is expected", lambda a: a * DEGREE),
    ("degrees_for_radians", "an azimuth in radians is turned into radians again", lambda a: a / DEGREE),
)


class Misreading(NamedTuple):
    """A fault and the measurement that it leads to expect."""

    fault: str
    words: str
    """What the tracker seems to do."""
    expect: Expect
    """From the target ``(4,)`` that it believes in, and the scan, to the measurement ``(m,)``."""


def misreadings(kind: str) -> list[Misreading]:
    """Every known fault of the measurement model of a kind of sensor, simpler ones first."""
    return [*(_lidar() if kind == "lidar" else _polar(kind)), *_posed()]


def _true(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _changed(change: Callable[[Array], Array]) -> Expect:
    return lambda target, scan: change(_true(target, scan))


def _azimuth(change: Callable[[float], float], fixed: bool = False) -> Expect:
    """The azimuth changed in the sensor's frame, or in the fixed frame before the sensor's yaw is taken off."""

    def expect(target: Array, scan: Scan) -> Array:
        z, yaw = _true(target, scan).copy(), scan.sensor_pose[2] if fixed else 0.0
        z[1] = change(float(z[1] + yaw)) - yaw
        return z

    return expect


def _polar(kind: str) -> Iterator[Misreading]:
    if kind == "radar":
        yield Misreading("doppler_sign", "the range rate has the other sign", _changed(lambda z: z * [1, 1, -1]))
        yield Misreading("speed_for_range_rate", "the third component is taken for the speed", _speed(relative=False))
        yield Misreading("speed_for_range_rate", "the third component is taken for the speed", _speed(relative=True))
        yield Misreading("ego_motion_ignored", "the range rate leaves out the sensor's own velocity", _at_rest)
    for fixed in (False, True):
        for fault, words, change in AZIMUTHS:
            yield Misreading(fault, words, _azimuth(change, fixed))


def _lidar() -> Iterator[Misreading]:
    yield Misreading("axis_swapped", "x and y are swapped", _changed(lambda z: z[::-1]))
    yield Misreading("axis_mirrored", "y has the other sign", _changed(lambda z: z * [1, -1]))
    yield Misreading("axis_mirrored", "x has the other sign", _changed(lambda z: z * [-1, 1]))
    yield Misreading("axis_swapped", "x and y are swapped, and one is mirrored", _changed(lambda z: z[::-1] * [1, -1]))
    yield Misreading("axis_swapped", "x and y are swapped, and one is mirrored", _changed(lambda z: z[::-1] * [-1, 1]))


def _posed() -> Iterator[Misreading]:
    """Faults in the sensor's own pose and velocity."""
    still, standing = np.zeros(2), np.ones(2)
    for words, keep_pose, keep_velocity in (
        ("the sensor's pose is left out", (0, 0, 0), standing),
        ("the sensor's position is left out", (0, 0, 1), standing),
        ("the sensor's yaw is left out", (1, 1, 0), standing),
        ("the sensor's pose and velocity are left out", (0, 0, 0), still),
        ("the sensor's position and velocity are left out", (0, 0, 1), still),
        ("the sensor's yaw and velocity are left out", (1, 1, 0), still),
    ):
        yield Misreading("ego_motion_ignored", words, _scaled(np.array(keep_pose, dtype=float), keep_velocity))
    for words, factor in (("taken for radians although in radians already", DEGREE), ("converted twice", 1 / DEGREE)):
        yield Misreading(
            "degrees_for_radians", f"the sensor's yaw is {words}", _scaled(np.array([1, 1, factor]), np.ones(2))
        )


def _scaled(pose: Array, velocity: Array) -> Expect:
    return lambda target, scan: SENSOR_MODELS[scan.kind].measure(
        target, scan.sensor_pose * pose, scan.sensor_velocity * velocity
    )


def _at_rest(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, np.zeros(2))


def _speed(relative: bool) -> Expect:
    def expect(target: Array, scan: Scan) -> Array:
        z = _true(target, scan).copy()
        z[2] = float(np.hypot(*(target[2:] - (scan.sensor_velocity if relative else 0.0))))
        return z

    return expect

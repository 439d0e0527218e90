"""Measurement models with one known fault each, to explain wrong innovations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.probes import rotation

DEGREE = 180.0 / np.pi

#: Fault, description, and function that gives the wrong azimuth for the right one.
AZIMUTHS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("arctan_quadrant", "azimuths behind the sensor are predicted ahead of it", lambda a: np.arctan(np.tan(a))),
    ("axis_mirrored", "the azimuth is measured clockwise", lambda a: -a),
    ("axis_mirrored", "the x axis points backward", lambda a: np.pi - a),
    ("axis_swapped", "the azimuth is measured from the y axis", lambda a: np.pi / 2 - a),
    ("degrees_for_radians", "the azimuth is predicted in degrees", lambda a: a * DEGREE),
    ("degrees_for_radians", "the azimuth in radians is converted to radians again", lambda a: a / DEGREE),
)

#: Description, and function that gives what is subtracted from the range rate over ground: of the sensor's own
#: velocity ``(2,)``, its yaw and the line of sight ``(2,)``.
EGO_VELOCITIES: tuple[tuple[str, Callable[[Array, float, Array], float]], ...] = (
    ("the sensor's own velocity is added to the target's", lambda v, _, sight: -float(v @ sight)),
    (
        "the sensor's own velocity counts along its boresight, not along the line of sight",
        lambda v, yaw, _: float(v @ rotation(yaw)[:, 0]),
    ),
    ("the sensor's own speed is subtracted from the range rate", lambda v, *_: float(np.hypot(*v))),
    ("the sensor's own speed is added to the range rate", lambda v, *_: -float(np.hypot(*v))),
    (
        "the sensor's own velocity is turned into its frame, and the line of sight is not",
        lambda v, yaw, sight: float((rotation(-yaw) @ v) @ sight),
    ),
    (
        "the sensor's own velocity is turned by its yaw, and is in the fixed frame already",
        lambda v, yaw, sight: float((rotation(yaw) @ v) @ sight),
    ),
)


class WrongModel(NamedTuple):
    """A measurement model with one known fault, as a wrong tracker may have."""

    fault: str
    description: str
    """Clause that says what a tracker with this model does."""
    measure: Callable[[Array, Scan], Array]
    """Returns the predicted measurement ``(m,)`` of a target ``(4,)`` at a scan."""


def wrong_models(kind: str) -> Iterator[WrongModel]:
    """Yield the wrong measurement models for a kind of sensor, simple ones first."""
    if kind == "lidar":
        rotated = "x and y are swapped, and one has the other sign"
        for fault, description, order, signs in (
            ("axis_swapped", "x and y are swapped", -1, [1, 1]),
            ("axis_mirrored", "y has the other sign", 1, [1, -1]),
            ("axis_mirrored", "x has the other sign", 1, [-1, 1]),
            ("axis_swapped", rotated, -1, [1, -1]),
            ("axis_swapped", rotated, -1, [-1, 1]),
        ):
            yield WrongModel(fault, description, partial(_reordered, order=order, signs=signs))
    if kind == "radar":
        description = "the range rate has the other sign"
        yield WrongModel("doppler_sign", description, partial(_reordered, order=1, signs=[1, 1, -1]))
        for relative, signed in product((False, True), repeat=2):
            description = "the range rate is predicted as the speed" + " with the sign of the range rate" * signed
            yield WrongModel("speed_for_range_rate", description, partial(_speed, relative=relative, signed=signed))
        description = "the range rate is predicted as the velocity along the boresight"
        yield WrongModel("speed_for_range_rate", description, _forward)
        description = "the range rate leaves out the sensor's own velocity"
        yield WrongModel("ego_motion_ignored", description, partial(_with_scaled_pose, pose=(1, 1, 1), velocity=0))
        for description, ego_rate in EGO_VELOCITIES:
            yield WrongModel("ego_motion_wrong", description, partial(_rated, ego_rate=ego_rate))
    for fixed in (False, True) if kind != "lidar" else ():
        for fault, description, change in AZIMUTHS:
            yield WrongModel(fault, description, partial(_azimuth, change=change, fixed=fixed))
    for description, pose, velocity in (
        ("the sensor's pose is left out", (0, 0, 0), 1),
        ("the sensor's position is left out", (0, 0, 1), 1),
        ("the sensor's yaw is left out", (1, 1, 0), 1),
        ("the sensor's pose and velocity are left out", (0, 0, 0), 0),
        ("the sensor's position and velocity are left out", (0, 0, 1), 0),
        ("the sensor's yaw and velocity are left out", (1, 1, 0), 0),
    ):
        yield WrongModel("ego_motion_ignored", description, partial(_with_scaled_pose, pose=pose, velocity=velocity))
    for description, pose in (
        ("the sensor's position has the wrong sign", (-1, -1, 1)),
        ("the sensor's yaw has the wrong sign", (1, 1, -1)),
        ("the sensor's yaw is applied twice", (1, 1, 2)),
    ):
        yield WrongModel("ego_motion_wrong", description, partial(_with_scaled_pose, pose=pose, velocity=1))
    for description, factor in (("in degrees", DEGREE), ("converted to radians twice", 1 / DEGREE)):
        measure = partial(_with_scaled_pose, pose=(1, 1, factor), velocity=1)
        yield WrongModel("degrees_for_radians", f"the sensor's yaw is {description}", measure)


def right_measurement(target: Array, scan: Scan) -> Array:
    """Return the measurement ``(m,)`` of a target by the right model."""
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _reordered(target: Array, scan: Scan, order: int, signs: list[int]) -> Array:
    return right_measurement(target, scan)[::order] * signs


def _azimuth(target: Array, scan: Scan, change: Callable[[float], float], fixed: bool) -> Array:
    """Predict a changed azimuth: in the sensor's frame, or if ``fixed`` before the sensor's yaw is subtracted."""
    z, yaw = right_measurement(target, scan).copy(), scan.sensor_pose[2] if fixed else 0.0
    z[1] = change(float(z[1] + yaw)) - yaw
    return z


def _with_scaled_pose(target: Array, scan: Scan, pose: tuple[float, float, float], velocity: float) -> Array:
    pose_used, velocity_used = scan.sensor_pose * np.array(pose, dtype=float), scan.sensor_velocity * velocity
    return SENSOR_MODELS[scan.kind].measure(target, pose_used, velocity_used)


def _speed(target: Array, scan: Scan, relative: bool, signed: bool) -> Array:
    z = right_measurement(target, scan).copy()
    speed = float(np.hypot(*(target[2:] - (scan.sensor_velocity if relative else 0.0))))
    z[2] = np.copysign(speed, z[2]) if signed else speed
    return z


def _forward(target: Array, scan: Scan) -> Array:
    z = right_measurement(target, scan).copy()
    z[2] = rotation(float(scan.sensor_pose[2]))[:, 0] @ (target[2:] - scan.sensor_velocity)
    return z


def _rated(target: Array, scan: Scan, ego_rate: Callable[[Array, float, Array], float]) -> Array:
    """Predict the range rate with ``ego_rate`` subtracted, in place of the sensor's speed along the line of sight."""
    at_rest = scan._replace(sensor_velocity=np.zeros(2))
    z = right_measurement(target, at_rest).copy()
    sight = target[:2] - scan.sensor_pose[:2]
    z[2] -= ego_rate(scan.sensor_velocity, float(scan.sensor_pose[2]), sight / max(float(np.hypot(*sight)), 1e-9))
    return z

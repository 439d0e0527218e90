"""The same scans with other angles: of a sensor mounted at another yaw, and of the scene turned about the origin."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS

#: Angles by which a mounting or a scene is turned, rad: more than any azimuth is uncertain at the probes, and not so
#: much that a target behind the sensor is ahead of it.
TURNS = (0.6, -0.6)


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


def turned_scene(scan: Scan, angle: float) -> Scan:
    """The target, the sensor and its velocity turned about the origin."""
    turn, pose = rotation(angle), scan.sensor_pose
    turned = np.array([*(turn @ pose[:2]), wrap_angle(pose[2] + angle)])
    return scan._replace(sensor_pose=turned, sensor_velocity=turn @ scan.sensor_velocity)

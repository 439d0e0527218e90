"""Where a sensor is, and how it moves, on a moving observer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Observer
from trackbench.models.sensors import Mount


class SensorMotion(NamedTuple):
    """Pose and velocity of a sensor in the fixed frame."""

    pose: Array
    """``(3, steps)`` x m, y m, yaw rad."""
    velocity: Array
    """``(2, steps)`` m/s."""


def sensor_motion(observer: Observer, mount: Mount) -> SensorMotion:
    """The motion of a sensor fixed to the observer: its velocity includes that of the observer's rotation."""
    c, s = np.cos(observer.yaw), np.sin(observer.yaw)
    arm_x, arm_y = c * mount.x_m - s * mount.y_m, s * mount.x_m + c * mount.y_m
    yaw = observer.yaw + np.deg2rad(mount.yaw_deg)
    pose = np.stack([observer.px + arm_x, observer.py + arm_y, yaw])
    turn = observer.yaw_rate
    return SensorMotion(pose, np.stack([observer.vx - turn * arm_y, observer.vy + turn * arm_x]))

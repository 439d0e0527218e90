"""What every engine of the benchmark gets: one target, radar and lidar in turn, the same measurements for all."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Observer, Truth
from trackbench.models.sensors import Lidar, Radar

DT = 0.05
SENSORS = {
    "radar": Radar(
        rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=1.6, range_rate_sigma_mps=0.3, detection_probability=1
    ),
    "lidar": Lidar(rate_hz=10, phase_s=DT, position_sigma_m=0.15),
}


def weaving(steps: int) -> Truth:
    """One target that weaves past a fixed observer, its speed and turn rate changing all the time."""
    time = np.arange(steps) * DT
    yaw_rate = 0.3 * np.sin(time / 2)
    acceleration = np.cos(time / 3)
    speed = 10 + np.cumsum(acceleration) * DT
    course = 0.5 + np.cumsum(yaw_rate) * DT
    px, py = 20 + np.cumsum(speed * np.cos(course)) * DT, 10 + np.cumsum(speed * np.sin(course)) * DT
    zero = np.zeros(steps)
    kinematics = (values[:, None, None] for values in (px, py, course, course, speed, acceleration, yaw_rate))
    return Truth(
        time,
        ("target",),
        *kinematics,
        alive=np.ones((steps, 1), dtype=bool),
        length=np.array([4.5]),
        width=np.array([1.8]),
        observer=Observer(zero, zero, zero, zero, zero, zero),
        source={"source": "scripted"},
    )

"""Radar that measures the target's speed in place of its range rate, as the published program at 3 km assumes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.models.sensors.radar import Polar, Radar, along_sight

#: Speed below which the direction of motion is not defined, m/s; keeps the Jacobian finite at rest.
MIN_SPEED = 1e-6


class SpeedRadar(Polar):
    """Radar of range, azimuth and, in place of the range rate, the target's speed over ground.

    No real radar measures this; the published program was written for such measurements.
    """

    speed_sigma_mps: float = Field(ge=1e-6, le=1e4, description="Standard deviation of the speed, m/s.")

    pure = True
    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "speed")
    sigma_options: ClassVar[tuple[str, ...]] = ("range_sigma_m", "azimuth_sigma_deg", "speed_sigma_mps")

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, _ = Radar.measure(target, pose, velocity)
        return linalg.vector([r, azimuth, np.hypot(target[2], target[3])])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        h = Radar.jacobian(target, pose, velocity)
        inverse = 1.0 / np.maximum(np.hypot(target[2], target[3]), MIN_SPEED)
        return linalg.matrix([[*h[0]], [*h[1]], [0, 0, target[2] * inverse, target[3] * inverse]])

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        return along_sight(scan)

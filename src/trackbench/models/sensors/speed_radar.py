"""A radar that is taken to read the target's speed instead of its range rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from trackbench import linalg
from trackbench.models.sensors.radar import Radar, along_sight
from trackbench.types import Array, Scan

#: Speed below which the direction of motion is not defined, m/s; keeps the Jacobian finite at rest.
MIN_SPEED = 1e-6


class SpeedRadar(Radar):
    """Range m, azimuth rad (counter-clockwise from the boresight), speed of the target over ground m/s.

    No radar reads this, but trackers have been written and published for it.
    """

    kind: ClassVar[str] = "speed_radar"
    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "speed")

    def measure(self, target: Array, pose: Array, velocity: Array) -> Array:
        r, azimuth, _ = super().measure(target, pose, velocity)
        return linalg.vector([r, azimuth, np.hypot(target[2], target[3])])

    def jacobian(self, target: Array, pose: Array, velocity: Array) -> Array:
        h = super().jacobian(target, pose, velocity)
        inverse = 1.0 / np.maximum(np.hypot(target[2], target[3]), MIN_SPEED)
        return linalg.matrix([[*h[0]], [*h[1]], [0, 0, target[2] * inverse, target[3] * inverse]])

    def radial_velocity(self, scan: Scan) -> Array:
        return along_sight(scan)

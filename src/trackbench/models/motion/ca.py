"""Constant acceleration."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.base import MotionModel


class ConstantAcceleration(MotionModel):
    """State px, py, vx, vy, ax, ay; discrete white-noise jerk on each axis.

    The counterpart, one derivative higher, of Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    """

    jerk_sigma_mps3: Sigma = Field(description="Standard deviation of the jerk that drives the motion, m/s^3.")

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("jerk_sigma_mps3", "jerk_sigma_mps3")

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        return np.concatenate([p + dt * v + dt**2 / 2 * a, v + dt * a, a])

    def jacobian(self, x: Array, dt: float) -> Array:
        half = dt**2 / 2
        return linalg.matrix(
            [
                [1, 0, dt, 0, half, 0],
                [0, 1, 0, dt, 0, half],
                [0, 0, 1, 0, dt, 0],
                [0, 0, 0, 1, 0, dt],
                [0, 0, 0, 0, 1, 0],
                [0, 0, 0, 0, 0, 1],
            ]
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        third, half = dt**3 / 6, dt**2 / 2
        return linalg.matrix([[third, 0], [0, third], [half, 0], [0, half], [dt, 0], [0, dt]])

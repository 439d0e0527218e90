"""Constant velocity whose noise depends on the state: other along the path than across it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.base import Kinematics, MotionModel


class PathConstantVelocity(MotionModel):
    """State px, py, vx, vy; white acceleration along the direction of motion, and another across it.

    Source: Kirubarajan, Bar-Shalom, Pattipati and Kadar (2000), "Ground target tracking with variable structure IMM
    estimator", section III. The direction is that at the start of the step. A body at rest points along x.
    """

    along_sigma_mps2: Sigma = Field(description="Standard deviation of the acceleration along the path, m/s^2.")
    across_sigma_mps2: Sigma = Field(description="Standard deviation of the acceleration across the path, m/s^2.")

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    driving_noise: ClassVar[tuple[str, ...]] = ("along_sigma_mps2", "across_sigma_mps2")

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return linalg.matrix([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]])

    def noise_gain(self, x: Array, dt: float) -> Array:
        c, s = _direction(x)
        half = dt**2 / 2
        return linalg.matrix([[half * c, -half * s], [half * s, half * c], [dt * c, -dt * s], [dt * s, dt * c]])

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        c, s = _direction(x)
        along, across = noise
        return super().to_kinematics(x, linalg.vector([c * along - s * across, s * along + c * across]), resting)


def _direction(x: Array) -> tuple[Array, Array]:
    """Cosine and sine of the course."""
    speed = np.hypot(x[2], x[3])
    moving = speed > 0.0
    length = np.where(moving, speed, 1.0)
    return np.where(moving, x[2] / length, 1.0), np.where(moving, x[3] / length, 0.0)

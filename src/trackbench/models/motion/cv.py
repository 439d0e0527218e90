"""Constant velocity."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.base import MotionModel


class ConstantVelocity(MotionModel):
    """State px, py, vx, vy; discrete white-noise acceleration on each axis.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    """

    acceleration_sigma_mps2: Sigma = Field(
        description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "acceleration_sigma_mps2")

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return linalg.matrix([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]])

    def noise_gain(self, x: Array, dt: float) -> Array:
        return linalg.matrix([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])

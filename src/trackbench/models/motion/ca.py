"""Motion model of constant acceleration."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.axes import DrivenAxes, Rows


class ConstantAcceleration(DrivenAxes):
    """State px, py, vx, vy, ax, ay; white-noise jerk on each axis, constant over each step.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2, one derivative higher.
    """

    jerk_sigma_mps3: Sigma = Field(description="Standard deviation of the jerk that drives the motion, m/s^3.")

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    driving_noise: ClassVar[tuple[str, ...]] = ("jerk_sigma_mps3", "jerk_sigma_mps3")

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        return np.concatenate([p + dt * v + dt**2 / 2 * a, v + dt * a, a])

    def axis_jacobian(self, dt: float) -> Rows:
        return [[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]

    def axis_gain(self, dt: float) -> Rows:
        return [[dt**3 / 6], [dt**2 / 2], [dt]]

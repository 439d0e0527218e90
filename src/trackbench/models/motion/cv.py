"""Motion models of constant velocity, driven by a piecewise constant or by a continuous white acceleration."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.axes import DrivenAxes, Rows


class VelocityAxes(DrivenAxes):
    """State px, py, vx, vy with constant velocity."""

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def axis_jacobian(self, dt: float) -> Rows:
        return [[1, dt], [0, 1]]


class ConstantVelocity(VelocityAxes):
    """State px, py, vx, vy; white-noise acceleration on each axis, constant over each step.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    """

    acceleration_sigma_mps2: Sigma = Field(
        description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )

    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "acceleration_sigma_mps2")

    def axis_gain(self, dt: float) -> Rows:
        return [[dt**2 / 2], [dt]]


class ContinuousNoiseVelocity(VelocityAxes):
    """State px, py, vx, vy; white-noise acceleration on each axis that is continuous in time.

    The noise over a time does not depend on the number of scans in it. Its covariance has full rank; two independent
    driving noises per axis enter by its square root. Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.2.2.
    """

    acceleration_density_mps1p5: Sigma = Field(
        description="Root of the power spectral density of the acceleration that drives the motion, m/s^1.5: the "
        "standard deviation of what it adds to a velocity in 1 s."
    )

    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_density_mps1p5",) * 4

    def axis_gain(self, dt: float) -> Rows:
        root = np.sqrt(dt)
        return [[root * dt / 2, root * dt / np.sqrt(12)], [root, 0]]

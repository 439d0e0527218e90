"""Constant velocity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict, Field

from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.axes import NoiseForm, Rows, WhiteAxes, stated_by_form


class ConstantVelocity(WhiteAxes):
    """State px, py, vx, vy; white-noise acceleration on each axis.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2 (piecewise constant) and 6.2.2 (continuous).
    """

    acceleration_sigma_mps2: Sigma | None = Field(
        None, description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )
    acceleration_density_mps1p5: Sigma | None = Field(
        None,
        description="Root of the power spectral density of the acceleration that drives the motion, m/s^1.5: the "
        "standard deviation of what it adds to a velocity in 1 s. With noise: continuous.",
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "acceleration_sigma_mps2")
    noise_options: ClassVar[Mapping[NoiseForm, str]] = {
        "piecewise": "acceleration_sigma_mps2",
        "continuous": "acceleration_density_mps1p5",
    }
    model_config = ConfigDict(json_schema_extra=stated_by_form(noise_options))

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def axis_jacobian(self, dt: float) -> Rows:
        return [[1, dt], [0, 1]]

    def axis_gain(self, dt: float) -> Rows:
        if self.noise == "piecewise":
            return [[dt**2 / 2], [dt]]
        root = np.sqrt(dt)
        return [[root * dt / 2, root * dt / np.sqrt(12)], [root, 0]]

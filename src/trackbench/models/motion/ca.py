"""Constant acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import ConfigDict, Field

from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.models.motion.axes import NoiseForm, Rows, WhiteAxes, stated_by_form


class ConstantAcceleration(WhiteAxes):
    """State px, py, vx, vy, ax, ay; white-noise jerk on each axis.

    Piecewise constant: the counterpart, one derivative higher, of Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    Continuous: the same, section 6.2.3.
    """

    jerk_sigma_mps3: Sigma | None = Field(
        None, description="Standard deviation of the jerk that drives the motion, m/s^3."
    )
    jerk_density_mps2p5: Sigma | None = Field(
        None,
        description="Root of the power spectral density of the jerk that drives the motion, m/s^2.5: the standard "
        "deviation of what it adds to an acceleration in 1 s. With noise: continuous.",
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    driving_noise: ClassVar[tuple[str, ...]] = ("jerk_sigma_mps3", "jerk_sigma_mps3")
    noise_options: ClassVar[Mapping[NoiseForm, str]] = {
        "piecewise": "jerk_sigma_mps3",
        "continuous": "jerk_density_mps2p5",
    }
    model_config = ConfigDict(json_schema_extra=stated_by_form(noise_options))

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        return np.concatenate([p + dt * v + dt**2 / 2 * a, v + dt * a, a])

    def axis_jacobian(self, dt: float) -> Rows:
        return [[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]

    def axis_gain(self, dt: float) -> Rows:
        if self.noise == "piecewise":
            return [[dt**3 / 6], [dt**2 / 2], [dt]]
        root = np.sqrt(dt)
        p, v = root * dt**2, root * dt
        return [[p / 6, p / np.sqrt(48), p / np.sqrt(720)], [v / 2, v / np.sqrt(12), 0], [root, 0, 0]]

"""Constant velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench import linalg
from trackbench.models.motion.base import InitialSigmas, Kinematics
from trackbench.types import Array, Gaussian

SELECT = np.eye(4)


@dataclass(frozen=True)
class ConstantVelocity:
    """State px, py, vx, vy; discrete white-noise acceleration on each axis.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    """

    acceleration_sigma: float
    """m/s^2, per axis."""

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    angular: ClassVar[tuple[int, ...]] = ()
    linear: ClassVar[bool] = True

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        return (self.acceleration_sigma, self.acceleration_sigma)

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])

    def noise_gain(self, x: Array, dt: float) -> Array:
        return np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])

    def to_cartesian(self, x: Array) -> Array:
        return x

    def cartesian_jacobian(self, x: Array) -> Array:
        return SELECT

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        return belief

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        return belief

    def from_kinematics(self, motion: Kinematics) -> Array:
        vx, vy = motion.speed * np.cos(motion.course), motion.speed * np.sin(motion.course)
        return linalg.vector([motion.px, motion.py, vx, vy])

"""Constant acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench import linalg
from trackbench.models.motion.base import InitialSigmas, Kinematics
from trackbench.types import Array, Gaussian

SELECT = np.eye(4, 6)


@dataclass(frozen=True)
class ConstantAcceleration:
    """State px, py, vx, vy, ax, ay; discrete white-noise jerk on each axis.

    The counterpart, one derivative higher, of Bar-Shalom, Li and Kirubarajan (2001), section 6.3.2.
    """

    jerk_sigma: float
    """m/s^3, per axis."""

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    angular: ClassVar[tuple[int, ...]] = ()
    linear: ClassVar[bool] = True

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        return (self.jerk_sigma, self.jerk_sigma)

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        return np.concatenate([p + dt * v + dt**2 / 2 * a, v + dt * a, a])

    def jacobian(self, x: Array, dt: float) -> Array:
        return np.asarray(np.kron([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], np.eye(2)), dtype=float)

    def noise_gain(self, x: Array, dt: float) -> Array:
        return np.asarray(np.kron([[dt**3 / 6], [dt**2 / 2], [dt]], np.eye(2)), dtype=float)

    def to_cartesian(self, x: Array) -> Array:
        return x[:4]

    def cartesian_jacobian(self, x: Array) -> Array:
        return SELECT

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        return Gaussian(belief.mean[:4], belief.covariance[:4, :4])

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        mean, covariance = belief
        batch = mean.shape[1:]
        extended = np.zeros((6, 6, *batch))
        extended[:4, :4] = covariance
        extended[4, 4] = extended[5, 5] = sigmas.acceleration**2
        return Gaussian(np.concatenate([mean, np.zeros((2, *batch))]), extended)

    def from_kinematics(self, motion: Kinematics) -> Array:
        c, s = np.cos(motion.course), np.sin(motion.course)
        tangential, normal = motion.acceleration, motion.speed * motion.yaw_rate
        return linalg.vector(
            [
                *(motion.px, motion.py, motion.speed * c, motion.speed * s),
                *(tangential * c - normal * s, tangential * s + normal * c),
            ]
        )

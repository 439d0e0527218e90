"""Any motion model, driven by a process noise of stated variance."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.base.types import Array, Gaussian
from trackbench.models.motion.base import InitialSigmas, Kinematics, MotionModel


class ConstantProcessNoise(MotionModel):
    """A motion model whose process noise is the same at every step, however long the step is.

    Each component of the state is driven by a noise of its own; a step of no time has none.
    """

    motion: MotionModel
    variances: tuple[float, ...]
    """``(n,)`` diagonal of the covariance that a step adds, in the units of the state's components squared."""

    def model_post_init(self, context: Any) -> None:
        for name in ("components", "angular", "linear", "first_sigmas"):
            object.__setattr__(self, name, getattr(self.motion, name))

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        return tuple(np.sqrt(variance) for variance in self.variances)

    def transition(self, x: Array, dt: float) -> Array:
        return self.motion.transition(x, dt)

    def jacobian(self, x: Array, dt: float) -> Array:
        return self.motion.jacobian(x, dt)

    def noise_gain(self, x: Array, dt: float) -> Array:
        return np.where(dt > 0.0, np.eye(len(self.variances)), 0.0)

    def to_cartesian(self, x: Array) -> Array:
        return self.motion.to_cartesian(x)

    def cartesian_jacobian(self, x: Array) -> Array:
        return self.motion.cartesian_jacobian(x)

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        return self.motion.cartesian_belief(belief)

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        return self.motion.from_cartesian(belief, sigmas)

    def from_kinematics(self, motion: Kinematics) -> Array:
        return self.motion.from_kinematics(motion)

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        # Its noise drives the state, and no rate that the state does not have.
        none = np.zeros((len(self.motion.noise_sigma), *noise.shape[1:]))
        return self.motion.to_kinematics(x, none, resting)

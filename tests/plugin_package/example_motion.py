"""A motion model: exponentially correlated acceleration."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.types import Array
from trackbench.models.motion import MotionModel


class Singer(MotionModel):
    """State px, py, vx, vy, ax, ay; acceleration on each axis that forgets itself with a time constant.

    Source: Singer (1970), "Estimating optimal tracking filter performance for manned maneuvering targets". The noise
    that drives the acceleration is taken as constant over a step, with the strength that keeps the acceleration's
    variance what it is; Singer's own is white within the step.
    """

    acceleration_sigma_mps2: Positive = Field(description="Standard deviation of the acceleration, m/s^2.")
    time_constant_s: Positive = Field(10, description="Time after which it has forgotten all but a 1/e of itself, s.")

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "acceleration_sigma_mps2")

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        kept, to_v, to_p = self._response(dt)
        return np.concatenate([p + dt * v + to_p * a, v + to_v * a, kept * a])

    def jacobian(self, x: Array, dt: float) -> Array:
        kept, to_v, to_p = self._response(dt)
        return np.kron([[1, dt, to_p], [0, 1, to_v], [0, 0, kept]], np.eye(2))

    def noise_gain(self, x: Array, dt: float) -> Array:
        if dt == 0.0:
            return np.zeros((6, 2))
        tau = self.time_constant_s
        _, to_v, to_p = self._response(dt)
        fresh = np.sqrt(-np.expm1(-2 * dt / tau))
        drive = fresh / to_v
        return np.kron([[drive * tau * (dt**2 / 2 - to_p)], [drive * tau * (dt - to_v)], [fresh]], np.eye(2))

    def _response(self, dt: float) -> tuple[float, float, float]:
        """What an acceleration of 1 leaves in the acceleration, the velocity and the position after ``dt``."""
        tau = self.time_constant_s
        lost = -np.expm1(-dt / tau)
        return 1 - lost, tau * lost, tau * (dt - tau * lost)

"""Motion models as users write them: most of them say ``pure = True``, some of these wrongly."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from pydantic import PrivateAttr

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.models.motion import MotionModel

GAIN = 0.5


class Fading(MotionModel):
    """The velocity fades with a time constant, as the example of ``trackbench new motion-model`` has it."""

    acceleration_sigma_mps2: float = 2.0
    time_constant_s: float = 5.0

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "acceleration_sigma_mps2")
    pure = True

    def left(self, x: Array, dt: float) -> Any:
        """What is left of a velocity."""
        return np.exp(-dt / self.time_constant_s)

    def transition(self, x: Array, dt: float) -> Array:
        left = self.left(x, dt)
        way = self.time_constant_s * (1 - left)
        return np.concatenate([x[:2] + way * x[2:], left * x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        left = self.left(x, dt)
        way = self.time_constant_s * (1 - left)
        return linalg.matrix([[1, 0, way, 0], [0, 1, 0, way], [0, 0, left, 0], [0, 0, 0, left]])

    def noise_gain(self, x: Array, dt: float) -> Array:
        return linalg.matrix([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])


class Silent(Fading):
    """Does not say it again."""


class Nonlinear(Fading):
    """Fast objects are slowed down more."""

    linear: ClassVar[bool] = False
    pure = True

    def left(self, x: Array, dt: float) -> Any:
        fast = np.where(np.hypot(x[2], x[3]) > 6.0, 2.0, 1.0)
        return np.exp(-dt * fast / self.time_constant_s)

    def jacobian(self, x: Array, dt: float) -> Array:
        # The slowing down changes by steps, between which its derivative is zero.
        return super().jacobian(x, dt)


class ComputedOnce(Fading):
    """Computes something of its options at the first use."""

    pure = True

    @cached_property
    def rate(self) -> float:
        return 1.0 / self.time_constant_s

    def left(self, x: Array, dt: float) -> Any:
        return np.exp(-dt * self.rate)


class OptionAsNumber(Fading):
    """Its option goes through Python's own functions."""

    pure = True

    def left(self, x: Array, dt: float) -> Any:
        return np.exp(-dt * math.exp(-math.log(self.time_constant_s)))


class ReadsModule(Fading):
    """Reads a number of its module."""

    pure = True

    def left(self, x: Array, dt: float) -> Any:
        return np.exp(-dt * GAIN)


class ByLinearAlgebra(Fading):
    """Takes its noise from a factorisation."""

    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2",) * 4
    pure = True

    def noise_gain(self, x: Array, dt: float) -> Array:
        exact = [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]
        return np.kron(np.linalg.cholesky(exact), np.eye(2))


class BranchOnTime(Fading):
    """Asks how long the step is."""

    pure = True

    def noise_gain(self, x: Array, dt: float) -> Array:
        return super().noise_gain(x, dt) if dt > 0.15 else 2.0 * super().noise_gain(x, dt)


class ChangesItsInput(Fading):
    """Moves the state where it stands."""

    linear: ClassVar[bool] = False
    pure = True

    def transition(self, x: Array, dt: float) -> Array:
        x[:2] += dt * x[2:]
        return x.copy()


class CountsCalls(Fading):
    """Grows tired, but not at once."""

    linear: ClassVar[bool] = False
    pure = True
    _calls: int = PrivateAttr(0)

    def transition(self, x: Array, dt: float) -> Array:
        self._calls += 1
        return super().transition(x, dt) * (1.0 if self._calls < 8 else 0.5)


class LooksAtTheNext(Fading):
    """Takes an object's speed for that of another."""

    linear: ClassVar[bool] = False
    pure = True

    def transition(self, x: Array, dt: float) -> Array:
        return super().transition(x + 0.1 * (x - x[..., ::-1]), dt)


class AsksForAnArray(Fading):
    """Does something else with a state that is no array."""

    linear: ClassVar[bool] = False
    pure = True

    def left(self, x: Array, dt: float) -> Any:
        return np.exp(-dt / (self.time_constant_s if isinstance(x, np.ndarray) else 0.3))

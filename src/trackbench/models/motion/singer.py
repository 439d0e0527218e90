"""Singer's model of an acceleration that is correlated in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive, Sigma
from trackbench.base.types import Array
from trackbench.models.motion.axes import DrivenAxes, Rows

#: Number of terms of each series, exact to double precision below a ratio of 1.
TERMS = 24


def _series(first: int, share: Callable[[int], int]) -> Sequence[float]:
    return [(-1) ** k * share(k) / factorial(k + 1) for k in range(first, first + TERMS)]


#: Coefficients for the effect of an acceleration of 1 on the position, and for entries of the covariance.
TO_P = _series(2, lambda k: k + 1)
VELOCITY = _series(2, lambda k: 2**k - 2)
POSITION_ACCELERATION = _series(2, lambda k: 2**k - k - 1)
POSITION = _series(4, lambda k: 2**k - 2 * k - 2)


class _UnitStep(NamedTuple):
    """Singer's model over a step of 1, for a ratio b of the step to the time constant and a noise density of 1."""

    to_a: Array
    """Acceleration ``(...)`` after the step, for an acceleration of 1 before the step."""
    to_v: Array
    """Change ``(...)`` of the velocity during the step, for an acceleration of 1 before the step."""
    to_p: Array
    """Change ``(...)`` of the position during the step, for an acceleration of 1 before the step."""
    velocity: Array
    """Variance ``(...)`` that the noise adds to the velocity during the step."""
    position_acceleration: Array
    position: Array


def _unit_step(b: Any) -> _UnitStep:
    """Evaluate Singer's model over a unit step: closed forms, and power series where their terms nearly cancel."""
    near = b < 1.0
    small, far = np.where(near, b, 0.0), np.where(near, 1.0, b)
    e = np.exp(-far)

    def evaluate(coefficients: Sequence[float], closed: Array) -> Array:
        series: Any = coefficients[-1]
        for coefficient in coefficients[-2::-1]:
            series = series * small + coefficient
        return np.where(near, series, closed)

    to_p = evaluate(TO_P, (far - 1 + e) / far**2)
    return _UnitStep(
        np.exp(-b),
        np.where(near, 1 - small * to_p, (1 - e) / far),
        to_p,
        evaluate(VELOCITY, (far - (1 - e) * (3 - e) / 2) / far**3),
        evaluate(POSITION_ACCELERATION, ((1 - e * e) / 2 - far * e) / far**3),
        evaluate(POSITION, (far**3 / 3 - far**2 + far - 2 * far * e + (1 - e * e) / 2) / far**5),
    )


class Singer(DrivenAxes):
    """State px, py, vx, vy, ax, ay; exponentially correlated acceleration on each axis, driven by white noise.

    Source: Singer (1970), "Estimating optimal tracking filter performance for manned maneuvering targets", equations 9
    to 12. Exact for any step, from far below the time constant to far above.
    """

    acceleration_sigma_mps2: Sigma = Field(description="Standard deviation of the acceleration, m/s^2.")
    time_constant_s: Positive = Field(
        description="Time after which the autocorrelation of the acceleration is 1/e, s: some 60 s for a slow turn, "
        "10 s to 20 s for an evasive manoeuvre."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "ax", "ay")
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2",) * 6

    def transition(self, x: Array, dt: float) -> Array:
        p, v, a = x[:2], x[2:4], x[4:]
        unit = _unit_step(dt / self.time_constant_s)
        return np.concatenate([p + dt * v + dt**2 * unit.to_p * a, v + dt * unit.to_v * a, unit.to_a * a])

    def axis_jacobian(self, dt: float) -> Rows:
        unit = _unit_step(dt / self.time_constant_s)
        return [[1, dt, dt**2 * unit.to_p], [0, 1, dt * unit.to_v], [0, 0, unit.to_a]]

    def axis_gain(self, dt: float) -> Rows:
        unit = _unit_step(dt / self.time_constant_s)
        # Cholesky factor of the covariance of acceleration, velocity and position.
        a = np.sqrt(unit.to_v * (1 + unit.to_a) / 2)
        va, pa = unit.to_v**2 / (2 * a), unit.position_acceleration / a
        v = np.sqrt(unit.velocity - va**2)
        pv = (unit.to_p**2 / 2 - va * pa) / v
        p = np.sqrt(unit.position - pa**2 - pv**2)
        scale_a = np.sqrt(2 * dt / self.time_constant_s)
        scale_v, scale_p = scale_a * dt, scale_a * dt**2
        return [[scale_p * pa, scale_p * pv, scale_p * p], [scale_v * va, scale_v * v, 0], [scale_a * a, 0, 0]]

"""Base of the models with speed, yaw and yaw rate in their state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian
from trackbench.base.units import cos_sin
from trackbench.models.motion.base import UNKNOWN_ANGLE, InitialSigmas, Kinematics, MotionModel, pad_state

#: Half turn, rad, below which the series of the spherical Bessel functions are exact to double precision.
SMALL = 0.5
TERMS = range(8)
#: Coefficients of the powers of h^2 in j0(h), in j1(h) / h and in the derivative of j1(h).
J0 = [(-1) ** k / factorial(2 * k + 1) for k in TERMS]
J1 = [(-1) ** k * (2 * k + 2) / factorial(2 * k + 3) for k in TERMS]
J1_SLOPE = [(2 * k + 1) * coefficient for k, coefficient in zip(TERMS, J1, strict=True)]


def bessel0(h: Array) -> Array:
    """Compute ``sin(h) / h``, the spherical Bessel function j0."""
    return _near_and_far(h, _series(J0, h), lambda far: cos_sin(far)[1] / far)


def bessel1(h: Array) -> Array:
    """Compute the spherical Bessel function j1, ``(sin(h) - h cos(h)) / h^2``, minus the derivative of j0."""

    def closed(far: Array) -> Array:
        c, s = cos_sin(far)
        return (s - far * c) / (far * far)

    return _near_and_far(h, h * _series(J1, h), closed)


def bessel1_slope(h: Array) -> Array:
    """Compute the derivative of the spherical Bessel function j1: ``j0(h) - 2 j1(h) / h``."""
    return _near_and_far(h, _series(J1_SLOPE, h), lambda far: bessel0(far) - 2.0 * bessel1(far) / far)


def _series(coefficients: Sequence[float], h: Array) -> Array:
    square = h * h
    result = coefficients[-1] * square + coefficients[-2]
    for coefficient in coefficients[-3::-1]:
        result = result * square + coefficient
    return result


def _near_and_far(h: Array, series: Array, closed: Callable[[Array], Array]) -> Array:
    near = np.abs(h) < SMALL
    if np.all(near):
        return series
    return np.where(near, series, closed(np.where(near, 1.0, h)))


class Arc(NamedTuple):
    """Displacement ``(...)`` along a path of constant yaw rate and constant acceleration over a time ``dt``.

    The integral of ``(v + a t) exp(i (yaw + w t))`` is ``dt exp(i (yaw + h)) (u j0(h) + i b j1(h))`` with the half turn
    ``h = w dt / 2``, mean speed ``u = v + b`` and ``b = a dt / 2``: no singularity at a yaw rate of zero.
    """

    dx: Array
    dy: Array
    cos: Array
    """Cosine ``(...)`` of the yaw half way along each path."""
    sin: Array


def arc(yaw: Array, yaw_rate: Array, mean_speed: Array, half_gain: Array | None, dt: float | Array) -> Arc:
    """Compute the displacement over ``dt``; ``mean_speed`` and ``half_gain`` are ``u`` and ``b`` of :class:`Arc`."""
    half = yaw_rate * (0.5 * dt)
    c, s = cos_sin(yaw + half)
    along = dt * mean_speed * bessel0(half)
    if half_gain is None:
        return Arc(along * c, along * s, c, s)
    across = dt * half_gain * bessel1(half)
    return Arc(along * c - across * s, along * s + across * c, c, s)


def to_cartesian(x: Array) -> Array:
    """Convert a state px, py, v, yaw, ... to px, py, vx, vy ``(4, ...)``."""
    px, py, v, yaw = x[:4]
    c, s = cos_sin(yaw)
    return linalg.vector([px, py, v * c, v * s])


def cartesian_jacobian(x: Array) -> Array:
    """Return the derivative ``(4, n, ...)`` of ``to_cartesian`` with respect to the state."""
    v, yaw = x[2], x[3]
    c, s = cos_sin(yaw)
    rest = [0.0] * (len(x) - 4)
    return linalg.matrix([[1, 0, 0, 0, *rest], [0, 1, 0, 0, *rest], [0, 0, c, -v * s, *rest], [0, 0, s, v * c, *rest]])


def cartesian_belief(belief: Gaussian) -> Gaussian:
    """Convert a belief to px, py, vx, vy: the mean to first order, the covariance to second.

    To first order a speed of zero would make the velocity across the yaw certain; the second-order term keeps the
    covariance definite there. Source: Bar-Shalom, Li and Kirubarajan (2001), section 10.3.2.
    """
    x, p = belief
    v = x[2]
    c, s = cos_sin(x[3])
    to_velocity = linalg.matrix([[c, -v * s], [s, v * c]])
    var_v, var_yaw, common = p[2, 2], p[3, 3], p[2, 3]
    # Half the trace of H_i P H_j P, with H_i the Hessians of v cos(yaw) and v sin(yaw) in the frame of the yaw.
    across, bend = var_v * var_yaw + common**2, -v * var_yaw
    along = 0.5 * bend**2
    mixed = bend * common
    rotation = linalg.matrix([[c, -s], [s, c]])
    second = linalg.quadratic(rotation, linalg.matrix([[along, mixed], [mixed, across]]))
    result = p[:4, :4].copy()
    result[:2, 2:] = linalg.matmul_transposed(p[:2, 2:4], to_velocity)
    result[2:, :2] = np.swapaxes(result[:2, 2:], 0, 1)
    result[2:, 2:] = linalg.quadratic(to_velocity, p[2:4, 2:4]) + second
    return Gaussian(linalg.vector([x[0], x[1], v * c, v * s]), linalg.rounded_up(result))


def _cartesian_moments(belief: Gaussian) -> Gaussian:
    """Return the exact mean and covariance of px, py, vx, vy under a belief, however large the variance of the yaw.

    With ``u = v exp(i yaw)``: under a Gaussian ``z``, ``E[g(z) exp(i k yaw)]`` is ``exp(i k m_yaw - k^2 P_yaw / 2)``
    times ``E[g(z + i k P_{:,yaw})]``, the characteristic function with a shifted mean.
    """
    x, p = belief
    v, common = x[2], p[2, 3]
    first = np.exp(1j * x[3] - 0.5 * p[3, 3])
    moved = v + 1j * common
    mean = first * moved
    square = first**2 * np.exp(-p[3, 3]) * ((v + 2j * common) ** 2 + p[2, 2])
    length = v * v + p[2, 2]
    with_position = first * (p[:2, 2] + 1j * p[:2, 3] * moved)
    result = np.empty((4, 4, *v.shape))
    result[:2, :2] = p[:2, :2]
    result[:2, 2], result[:2, 3] = with_position.real, with_position.imag
    result[2:, :2] = np.swapaxes(result[:2, 2:], 0, 1)
    result[2, 2] = 0.5 * (length + square.real) - mean.real**2
    result[3, 3] = 0.5 * (length - square.real) - mean.imag**2
    result[2, 3] = result[3, 2] = 0.5 * square.imag - mean.real * mean.imag
    return Gaussian(linalg.vector([x[0], x[1], mean.real, mean.imag]), result)


class SpeedAndYaw(MotionModel):
    """Base of models whose state begins with px, py, v, yaw, yaw rate, with conversions from and to Cartesian."""

    def to_cartesian(self, x: Array) -> Array:
        return to_cartesian(x)

    def cartesian_jacobian(self, x: Array) -> Array:
        return cartesian_jacobian(x)

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        return cartesian_belief(belief)

    def cartesian_moments(self, belief: Gaussian) -> Gaussian:
        return _cartesian_moments(belief)

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        """Convert a Cartesian belief to position, speed and yaw, to first order; other components are zero.

        To first order the sigma of the yaw grows without bound as the speed goes to zero. It is limited to the sigma of
        an unknown angle; correlations stay.
        """
        px, py, vx, vy = belief.mean
        speed = np.hypot(vx, vy)
        safe = np.maximum(speed, 1e-3)
        moving = speed > 0.0
        length = np.where(moving, speed, 1.0)
        c, s = np.where(moving, vx / length, 1.0), np.where(moving, vy / length, 0.0)
        slope = linalg.matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s], [0, 0, -s / safe, c / safe]])
        p = linalg.quadratic(slope, belief.covariance)
        scale = np.minimum(1.0, UNKNOWN_ANGLE / np.sqrt(p[3, 3]))
        p = p * linalg.matrix([[1, 1, 1, scale]] * 3 + [[scale, scale, scale, scale**2]])
        mean = linalg.vector([px, py, speed, np.arctan2(vy, vx)])
        return pad_state(self, Gaussian(mean, linalg.rounded_up(p)), sigmas)

    def from_kinematics(self, motion: Kinematics) -> Array:
        values = {
            "px": motion.px,
            "py": motion.py,
            "v": motion.speed,
            "yaw": motion.course,
            "yaw_rate": motion.yaw_rate,
            "a": motion.acceleration,
        }
        return linalg.vector([values.get(name, np.zeros_like(motion.px)) for name in self.components])

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        px, py, speed, yaw, yaw_rate = x[:5]
        acceleration = x[self.components.index("a")] if "a" in self.components else noise[0]
        return Kinematics(px, py, speed, yaw, acceleration, yaw_rate)

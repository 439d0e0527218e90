"""Motion model of constant turn rate and acceleration."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.base.units import cos_sin
from trackbench.models.motion import turning


class ConstantTurnRateAcceleration(turning.SpeedAndYaw):
    """State px, py, v, yaw, yaw rate, a; white jerk along the path and white yaw acceleration.

    Source: Schubert, Richter and Wanielik (2008), "Comparison and evaluation of advanced motion models for vehicle
    tracking", section III; the noise gain takes the heading at the start of the interval.
    """

    jerk_sigma_mps3: Sigma = Field(description="Standard deviation of the jerk that drives the motion, m/s^3.")
    yaw_acceleration_sigma_radps2: Sigma = Field(
        description="Standard deviation of the yaw acceleration that drives the motion, rad/s^2."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "v", "yaw", "yaw_rate", "a")
    angular: ClassVar[tuple[int, ...]] = (3,)
    driving_noise: ClassVar[tuple[str, ...]] = ("jerk_sigma_mps3", "yaw_acceleration_sigma_radps2")

    def transition(self, x: Array, dt: float | Array) -> Array:
        px, py, v, yaw, w, a = x
        gain = a * (0.5 * dt)
        path = turning.arc(yaw, w, v + gain, gain, dt)
        return linalg.vector([px + path.dx, py + path.dy, v + a * dt, yaw + w * dt, w, a])

    def jacobian(self, x: Array, dt: float) -> Array:
        _, _, v, yaw, w, a = x
        gain = a * (0.5 * dt)
        path = turning.arc(yaw, w, v + gain, gain, dt)
        c, s = path.cos, path.sin
        half = w * (0.5 * dt)
        j0, j1 = turning.bessel0(half), turning.bessel1(half)
        along_slope = -dt * (v + gain) * j1
        across_slope = dt * gain * turning.bessel1_slope(half)
        turn_x = dt / 2 * (-path.dy + along_slope * c - across_slope * s)
        turn_y = dt / 2 * (path.dx + along_slope * s + across_slope * c)
        per_a = dt**2 / 2
        return linalg.matrix(
            [
                [1, 0, dt * j0 * c, -path.dy, turn_x, per_a * (j0 * c - j1 * s)],
                [0, 1, dt * j0 * s, path.dx, turn_y, per_a * (j0 * s + j1 * c)],
                [0, 0, 1, 0, 0, dt],
                [0, 0, 0, 1, dt, 0],
                [0, 0, 0, 0, 1, 0],
                [0, 0, 0, 0, 0, 1],
            ]
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        c, s = cos_sin(x[3])
        third, half = dt**3 / 6, dt**2 / 2
        return linalg.matrix([[third * c, 0], [third * s, 0], [half, 0], [0, half], [0, dt], [dt, 0]])

"""Motion model of constant turn rate and velocity."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.base.units import cos_sin
from trackbench.models.motion import turning


class ConstantTurnRateVelocity(turning.SpeedAndYaw):
    """State px, py, v, yaw, yaw rate; white acceleration along the path and white yaw acceleration.

    Source: Schubert, Richter and Wanielik (2008), "Comparison and evaluation of advanced motion models for vehicle
    tracking", section III; the noise gain takes the heading at the start of the interval.
    """

    acceleration_sigma_mps2: Sigma = Field(
        description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )
    yaw_acceleration_sigma_radps2: Sigma = Field(
        description="Standard deviation of the yaw acceleration that drives the motion, rad/s^2."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "v", "yaw", "yaw_rate")
    angular: ClassVar[tuple[int, ...]] = (3,)
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "yaw_acceleration_sigma_radps2")

    def transition(self, x: Array, dt: float) -> Array:
        px, py, v, yaw, w = x
        path = turning.arc(yaw, w, v, None, dt)
        return linalg.vector([px + path.dx, py + path.dy, v, yaw + w * dt, w])

    def jacobian(self, x: Array, dt: float) -> Array:
        _, _, v, yaw, w = x
        path = turning.arc(yaw, w, v, None, dt)
        half = w * (0.5 * dt)
        per_speed = dt * turning.bessel0(half)
        shrink = dt * v * turning.bessel1(half)
        return linalg.matrix(
            [
                [1, 0, per_speed * path.cos, -path.dy, dt / 2 * (-path.dy - shrink * path.cos)],
                [0, 1, per_speed * path.sin, path.dx, dt / 2 * (path.dx - shrink * path.sin)],
                [0, 0, 1, 0, 0],
                [0, 0, 0, 1, dt],
                [0, 0, 0, 0, 1],
            ]
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        c, s = cos_sin(x[3])
        half = dt**2 / 2
        return linalg.matrix([[half * c, 0], [half * s, 0], [dt, 0], [0, half], [0, dt]])

"""Motion model of a nearly constant turn, in position, velocity and turn rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Sigma
from trackbench.base.types import Array
from trackbench.base.units import cos_sin
from trackbench.models.motion.base import Kinematics, MotionModel
from trackbench.models.motion.turning import bessel0, bessel1


def turned(velocity: Array, angle: Array) -> Array:
    """Turn a vector ``(2, ...)`` counter-clockwise by an angle in rad."""
    c, s = cos_sin(angle)
    return linalg.vector([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1]])


class Turn(MotionModel):
    """State px, py, vx, vy, yaw rate; nearly constant turn: white acceleration on each axis, white yaw acceleration.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 11.7.1, equations 11.7.1-4 and 11.7.2-3, without their
    singularity at a turn rate of zero.
    """

    acceleration_sigma_mps2: Sigma = Field(
        description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )
    yaw_acceleration_sigma_radps2: Sigma = Field(
        description="Standard deviation of the yaw acceleration that drives the motion, rad/s^2."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy", "yaw_rate")
    driving_noise: ClassVar[tuple[str, ...]] = (
        "acceleration_sigma_mps2",
        "acceleration_sigma_mps2",
        "yaw_acceleration_sigma_radps2",
    )

    def transition(self, x: Array, dt: float) -> Array:
        half = x[4] * (0.5 * dt)
        way = dt * bessel0(half) * turned(x[2:4], half)
        return np.concatenate([x[:2] + way, turned(x[2:4], 2 * half), x[4:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        half = x[4] * (0.5 * dt)
        way = dt * bessel0(half)
        (c, s), (cv, sv) = cos_sin(half), cos_sin(2 * half)
        middle, end = turned(x[2:4], half), turned(x[2:4], 2 * half)
        # A turn has as derivative the turn by 90 degrees more.
        shrink = dt * bessel1(half)
        px, py = dt / 2 * (-shrink * middle[0] - way * middle[1]), dt / 2 * (-shrink * middle[1] + way * middle[0])
        return linalg.matrix(
            [
                [1, 0, way * c, -way * s, px],
                [0, 1, way * s, way * c, py],
                [0, 0, cv, -sv, -dt * end[1]],
                [0, 0, sv, cv, dt * end[0]],
                [0, 0, 0, 0, 1],
            ]
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        half = dt**2 / 2
        return linalg.matrix([[half, 0, 0], [0, half, 0], [dt, 0, 0], [0, dt, 0], [0, 0, dt]])

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        return super().to_kinematics(x, noise[:2], resting)._replace(yaw_rate=x[4])

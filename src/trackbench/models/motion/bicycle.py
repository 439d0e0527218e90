"""The kinematic bicycle: a vehicle whose rear wheels do not slip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Positive, Sigma
from trackbench.base.types import Array
from trackbench.base.units import cos_sin
from trackbench.models.motion import turning
from trackbench.models.motion.base import Kinematics


class KinematicBicycle(turning.SpeedAndYaw):
    """State px, py, v, yaw, slip; white acceleration along the path, and a white rate of the slip angle.

    The yaw is the direction in which the point that is tracked moves; the body's axis points to yaw minus slip. It
    turns at ``v sin(slip) / l`` with l the distance of the rear axle. Source: Polack, Altché, d'Andréa-Novel and de La
    Fortelle (2017), "The kinematic bicycle model: a consistent model for planning feasible trajectories for autonomous
    vehicles?", equations 1; the noise gain takes the state at the start of the step.
    """

    acceleration_sigma_mps2: Sigma = Field(
        description="Standard deviation of the acceleration that drives the motion, m/s^2."
    )
    slip_rate_sigma_radps: Sigma = Field(
        description="Standard deviation of the rate of the slip angle, by which the vehicle is steered, rad/s."
    )
    rear_axle_m: Positive = Field(
        1.4, description="Distance of the rear axle behind the point that is tracked, m. Half the wheelbase of a car."
    )

    components: ClassVar[tuple[str, ...]] = ("px", "py", "v", "yaw", "slip")
    angular: ClassVar[tuple[int, ...]] = (3, 4)
    driving_noise: ClassVar[tuple[str, ...]] = ("acceleration_sigma_mps2", "slip_rate_sigma_radps")
    #: Of the slip, rad: a radius of 28 m with the usual axle.
    first_sigmas: ClassVar[Mapping[str, float]] = {"slip": 0.05}

    def transition(self, x: Array, dt: float) -> Array:
        px, py, v, yaw, slip = x
        w = v * cos_sin(slip)[1] / self.rear_axle_m
        path = turning.arc(yaw, w, v, None, dt)
        return linalg.vector([px + path.dx, py + path.dy, v, yaw + w * dt, slip])

    def jacobian(self, x: Array, dt: float) -> Array:
        _, _, v, yaw, slip = x
        c, s = cos_sin(slip)
        per_v, per_slip = s / self.rear_axle_m, v * c / self.rear_axle_m
        path = turning.arc(yaw, v * per_v, v, None, dt)
        half = v * per_v * (0.5 * dt)
        way, shrink = dt * turning.bessel0(half), dt * v * turning.bessel1(half)
        turn_x, turn_y = dt / 2 * (-path.dy - shrink * path.cos), dt / 2 * (path.dx - shrink * path.sin)
        return linalg.matrix(
            [
                [1, 0, way * path.cos + turn_x * per_v, -path.dy, turn_x * per_slip],
                [0, 1, way * path.sin + turn_y * per_v, path.dx, turn_y * per_slip],
                [0, 0, 1, 0, 0],
                [0, 0, dt * per_v, 1, dt * per_slip],
                [0, 0, 0, 0, 1],
            ]
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        (c, s), v, half = cos_sin(x[3]), x[2], dt**2 / 2
        turn = dt + half * v * cos_sin(x[4])[0] / self.rear_axle_m
        return linalg.matrix([[half * c, -half * v * s], [half * s, half * v * c], [dt, 0], [0, turn], [0, dt]])

    def from_kinematics(self, motion: Kinematics) -> Array:
        most = np.abs(motion.speed)
        across = np.clip(self.rear_axle_m * motion.yaw_rate, -most, most)
        slip = np.arcsin(across / np.where(most > 0.0, motion.speed, 1.0))
        return linalg.vector([motion.px, motion.py, motion.speed, motion.course, slip])

    def to_kinematics(self, x: Array, noise: Array, resting: Array) -> Kinematics:
        px, py, v, yaw, slip = x
        return Kinematics(px, py, v, yaw, noise[0], v * np.sin(slip) / self.rear_axle_m + noise[1])

"""Radar: range, azimuth, range rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Angle
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.base.units import cos_sin, exp_minus_one
from trackbench.models.sensors.base import Sensor

#: Range below which the direction to a target is not defined, m; keeps Jacobians finite on the sensor itself.
MIN_RANGE = 1e-6


class Polar(Sensor):
    """What the kinds of radar have in common: range m, azimuth rad from the boresight, and a third component, m/s."""

    range_sigma_m: float = Field(ge=1e-6, le=1e4, description="Standard deviation of the range, m.")
    azimuth_sigma_deg: float = Field(ge=1e-7, le=90, description="Standard deviation of the azimuth, degrees.")
    range_bias_m: float = Field(0, description="Constant error of the range, m.")
    azimuth_bias_deg: Angle = Field(0, description="Constant error of the azimuth, degrees.")

    angular: ClassVar[tuple[int, ...]] = (1,)
    units: ClassVar[tuple[str, ...]] = ("m", "rad", "m/s")

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        """Unbiased conversion from polar to Cartesian.

        Source: Mo, Song, Zhou, Sun and Bar-Shalom (1998), "Unbiased converted measurements for tracking", with the
        covariance conditioned on the measurement, along and across the line of sight: at the axes its squares of the
        range, which are far larger, would have to cancel.
        """
        r, azimuth = scan.measurement[0], scan.measurement[1]
        var_r, var_a = scan.noise_covariance[0, 0], scan.noise_covariance[1, 1]
        shrink = np.exp(-var_a / 2)
        angle = azimuth + scan.sensor_pose[2]
        c, s = cos_sin(angle)
        mean = linalg.vector([scan.sensor_pose[0] + r * c / shrink, scan.sensor_pose[1] + r * s / shrink])
        loss = -0.5 * exp_minus_one(-2.0 * var_a)
        along = r * r * (exp_minus_one(var_a) - loss) + var_r * (1.0 - loss)
        across = (r * r + var_r) * loss
        xx, yy = along * c * c + across * s * s, along * s * s + across * c * c
        xy = (along - across) * c * s
        return Gaussian(mean, linalg.rounded_up(linalg.matrix([[xx, xy], [xy, yy]])))


class Radar(Polar):
    """Measures range, azimuth and range rate (relative to the moving sensor)."""

    range_rate_sigma_mps: float = Field(ge=1e-6, le=1e4, description="Standard deviation of the range rate, m/s.")
    range_rate_bias_mps: float = Field(0, description="Constant error of the range rate, m/s.")

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "range_rate")
    sigma_options: ClassVar[tuple[str, ...]] = ("range_sigma_m", "azimuth_sigma_deg", "range_rate_sigma_mps")

    def biases(self) -> tuple[float, ...]:
        return (self.range_bias_m, np.deg2rad(self.azimuth_bias_deg), self.range_rate_bias_mps)

    def uniform(self, shares: Array) -> Array:
        """Uniform in range, azimuth and range rate."""
        low, high = self.clutter.range_rate_mps
        fov = np.deg2rad(self.fov_deg)
        assert self.max_range_m is not None
        return np.stack([shares[0] * self.max_range_m, (shares[1] - 0.5) * fov, low + shares[2] * (high - low)])

    def volume(self) -> float:
        """m rad m/s."""
        low, high = self.clutter.range_rate_mps
        assert self.max_range_m is not None
        return float(self.max_range_m * np.deg2rad(self.fov_deg) * (high - low))

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        r = np.maximum(np.sqrt(dx * dx + dy * dy), MIN_RANGE)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        azimuth = np.arctan2(c * dy - s * dx, c * dx + s * dy)
        rate = (dx * (target[2] - velocity[0]) + dy * (target[3] - velocity[1])) / r
        return linalg.vector([r, azimuth, rate])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        inverse = 1.0 / np.maximum(np.sqrt(dx * dx + dy * dy), MIN_RANGE)
        ux, uy = dx * inverse, dy * inverse
        # Velocity across the line of sight, over the range: the rate at which the line of sight turns.
        turn = (ux * (target[3] - velocity[1]) - uy * (target[2] - velocity[0])) * inverse
        return linalg.matrix([[ux, uy, 0, 0], [-uy * inverse, ux * inverse, 0, 0], [-uy * turn, ux * turn, ux, uy]])

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        along = along_sight(scan)
        return linalg.vector([along[0] + scan.sensor_velocity[0], along[1] + scan.sensor_velocity[1]])


def along_sight(scan: Scan) -> Array:
    """``(2, ...)`` the third component of a measurement as a vector along the line of sight, in the fixed frame."""
    c, s = cos_sin(scan.measurement[1] + scan.sensor_pose[2])
    return linalg.vector([scan.measurement[2] * c, scan.measurement[2] * s])

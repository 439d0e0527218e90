"""How wrong a sensor is, in SI units and radians."""

from __future__ import annotations

import numpy as np

from trackbench.sensing.config import RadarConfig, Sensor, SpeedRadarConfig
from trackbench.types import Array


def standard_deviations(config: Sensor) -> Array:
    """``(m,)`` standard deviation of each component of a measurement."""
    if isinstance(config, RadarConfig | SpeedRadarConfig):
        last = config.range_rate_sigma_mps if isinstance(config, RadarConfig) else config.speed_sigma_mps
        return np.array([config.range_sigma_m, np.deg2rad(config.azimuth_sigma_deg), last])
    return np.array([config.position_sigma_m, config.position_sigma_m])


def noise_covariance(config: Sensor) -> Array:
    """``(m, m)`` covariance that the sensor states of its measurements."""
    return np.diag(standard_deviations(config) ** 2)


def biases(config: Sensor) -> Array:
    """``(m,)`` constant error of each component of a measurement."""
    if isinstance(config, RadarConfig | SpeedRadarConfig):
        last = config.range_rate_bias_mps if isinstance(config, RadarConfig) else config.speed_bias_mps
        return np.array([config.range_bias_m, np.deg2rad(config.azimuth_bias_deg), last])
    return np.array([config.x_bias_m, config.y_bias_m])

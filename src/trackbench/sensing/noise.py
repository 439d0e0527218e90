"""How wrong a sensor is, in SI units and radians."""

from __future__ import annotations

import numpy as np

from trackbench.sensing.config import LidarConfig, RadarConfig
from trackbench.types import Array


def standard_deviations(config: RadarConfig | LidarConfig) -> Array:
    """``(m,)`` standard deviation of each component of a reading."""
    if isinstance(config, RadarConfig):
        return np.array([config.range_sigma_m, np.deg2rad(config.azimuth_sigma_deg), config.range_rate_sigma_mps])
    return np.array([config.position_sigma_m, config.position_sigma_m])


def biases(config: RadarConfig | LidarConfig) -> Array:
    """``(m,)`` constant error of each component of a reading."""
    if isinstance(config, RadarConfig):
        return np.array([config.range_bias_m, np.deg2rad(config.azimuth_bias_deg), config.range_rate_bias_mps])
    return np.array([config.x_bias_m, config.y_bias_m])

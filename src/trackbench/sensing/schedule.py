"""At which steps of the truth a sensor looks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Mask
from trackbench.models.sensors import Sensor

#: Instants are multiples of a step that is not exact in binary, s.
TOLERANCE = 5e-7


def firing_steps(config: Sensor, time: Array) -> npt.NDArray[np.intp]:
    """Indices of the truth steps at which the sensor measures: the first at or after each instant of its rate.

    On a regular grid whose rate that of the sensor divides, these are the instants themselves.
    """
    assert config.rate_hz is not None
    due = np.arange(config.phase_s, time[-1] + TOLERANCE, 1.0 / config.rate_hz)
    return np.unique(np.searchsorted(time, due - TOLERANCE))


def silent(config: Sensor, time: Array) -> Mask:
    """Whether the sensor is silent at each time; a dropout holds from its first instant to before its last."""
    mask = np.zeros(np.shape(time), dtype=bool)
    for dropout in config.dropouts:
        mask |= (time >= dropout.from_s - TOLERANCE) & (time < dropout.to_s - TOLERANCE)
    return mask

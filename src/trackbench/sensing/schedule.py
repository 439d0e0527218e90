"""At which steps of the truth a sensor looks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trackbench.sensing.config import SensorConfig
from trackbench.types import Array, Mask


def firing_steps(config: SensorConfig, time: Array) -> npt.NDArray[np.intp]:
    """Indices of the truth steps at which the sensor takes a reading; its rate divides that of the truth."""
    dt = time[1] - time[0] if len(time) > 1 else 1.0
    period = max(1, round(1.0 / (config.rate_hz * dt)))
    return np.arange(round(config.phase_s / dt), len(time), period)


def silent(config: SensorConfig, time: Array) -> Mask:
    """Whether the sensor is silent at each time; a dropout holds from its first instant to before its last."""
    mask = np.zeros(np.shape(time), dtype=bool)
    for dropout in config.dropouts:
        # Half a microsecond of tolerance: instants are multiples of a step that is not exact in binary.
        mask |= (time >= dropout.from_s - 5e-7) & (time < dropout.to_s - 5e-7)
    return mask

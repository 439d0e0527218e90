"""A tracker: positions smoothed by a fixed gain, from lidar-like and polar measurements alike."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from trackbench.models.sensors import SENSOR_MODELS


class LastPosition:
    """Position and velocity by fixed gains, of the position that each measurement states."""

    class Options(BaseModel):
        model_config = ConfigDict(extra="forbid")

        alpha: float = Field(0.4, gt=0, le=1, description="Gain of the position.")
        beta: float = Field(0.1, ge=0, le=1, description="Gain of the velocity.")

    def __init__(self, **options: Any) -> None:
        self.options = self.Options(**options)

    def step(self, state: Any, scan: Any) -> tuple[Any, Any]:
        position = SENSOR_MODELS[scan.kind].position(scan) if scan.valid else None
        if state is None:
            state = scan.time, np.concatenate([position.mean, [0.0, 0.0]])
        dt, x = scan.time - state[0], state[1].copy()
        x[:2] += dt * x[2:]
        if position is not None and dt > 0:
            residual = position.mean - x[:2]
            x += np.concatenate([self.options.alpha * residual, self.options.beta / dt * residual])
        return (scan.time, x), (x, np.diag([1.0, 1.0, 25.0, 25.0]))

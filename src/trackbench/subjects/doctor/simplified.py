"""A scenario's sensor as an examination has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.models.sensors import Sensor

#: Least and largest rate of a sensor, Hz: at 5 Hz sound turning models lose targets at the sensor, and the second order
#: of sigma points has innovations; the truth of drives has 100 steps a second.
RATES = (10.0, 50.0)


def rate_of(sensor: Sensor) -> float:
    """Its rate in an examination, Hz; where its measurements are recorded, 10 of a lidar and 20 of a radar."""
    return float(np.clip(sensor.rate_hz or (10.0 if sensor.type == "lidar" else 20.0), *RATES))


def simplified(sensor: Sensor) -> Sensor:
    """The sensor without limits of view, missed detections, delays and biases."""
    biases = {field: 0.0 for field in type(sensor).model_fields if "_bias_" in field}
    unlimited: dict[str, Any] = {
        "fov_deg": 360.0,
        "max_range_m": None,
        "detection_probability": 1.0,
        "dropouts": [],
    }
    rate = {"rate_hz": rate_of(sensor), "phase_s": 0.0, "latency_s": 0}
    return sensor.model_copy(update={**biases, **unlimited, **rate})

"""Columns of numbers and names to a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from trackbench.base.types import Array, Scan
from trackbench.models.sensors import SENSOR_MODELS

Columns = dict[str, Array | list[str]]


def stacked(parts: Sequence[Columns]) -> pa.Table:
    """One table of parts with the same columns."""
    if not parts:
        return pa.table({})
    joined: dict[str, pa.Array] = {}
    for key in parts[0]:
        values = [part[key] for part in parts]
        if isinstance(values[0], list):
            joined[key] = pa.array([text for part in values for text in part], pa.string()).dictionary_encode()
        else:
            joined[key] = pa.array(np.concatenate(values), from_pandas=True)
    return pa.table(joined)


def state_columns(mean: Array, covariance: Array) -> Columns:
    """Of states ``(4, rows)`` and covariances ``(4, 4, rows)``."""
    return {
        **dict(zip(("px_m", "py_m", "vx_mps", "vy_mps"), mean, strict=True)),
        **{f"p_{a}{b}": covariance[a, b] for a in range(4) for b in range(a, 4)},
    }


def measurement_columns(scan: Scan) -> Columns:
    """Of the measurements ``(m, rows)`` of a scan, with the position in the fixed frame that each states."""
    rows = scan.measurement.shape[1]
    position = SENSOR_MODELS[scan.kind].position(scan).mean
    third = scan.measurement[2] if len(scan.measurement) > 2 else np.full(rows, np.nan)
    return {
        "z0": scan.measurement[0],
        "z1": scan.measurement[1],
        "z2": third,
        "x_m": position[0],
        "y_m": position[1],
        "sensor_x_m": np.full(rows, scan.sensor_pose[0]),
        "sensor_y_m": np.full(rows, scan.sensor_pose[1]),
        "sensor_yaw_rad": np.full(rows, scan.sensor_pose[2]),
    }

"""The recorded run as tables with a unit in each column's name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from trackbench.base.types import Array, Indices, Scan, Truth
from trackbench.metrics.consistency import normalised_square
from trackbench.runner.columns import Columns, measurement_columns, stacked, state_columns
from trackbench.runner.recorded import RecordedEstimates


def truth_table(truth: Truth, run: int) -> pa.Table:
    """The motion of every target and of the observer in one run."""
    column = min(run, truth.px.shape[2] - 1)
    fields = {
        "px_m": truth.px,
        "py_m": truth.py,
        "heading_rad": truth.heading,
        "course_rad": truth.course,
        "speed_mps": truth.speed,
        "vx_mps": truth.vx,
        "vy_mps": truth.vy,
        "acceleration_mps2": truth.acceleration,
        "yaw_rate_radps": truth.yaw_rate,
    }
    steps = len(truth.time)
    parts: list[Columns] = []
    for i, name in enumerate(truth.ids):
        parts.append(
            {
                "object": [name] * steps,
                "role": ["target"] * steps,
                "time_s": truth.time,
                "alive": truth.alive[:, i].astype(float),
                **{key: values[:, i, column] for key, values in fields.items()},
                "length_m": np.full(steps, truth.length[i]),
                "width_m": np.full(steps, truth.width[i]),
            }
        )
    observer = truth.observer
    speed = np.hypot(observer.vx, observer.vy)
    parts.append(
        {
            "object": ["observer"] * steps,
            "role": ["observer"] * steps,
            "time_s": truth.time,
            "alive": np.ones(steps),
            "px_m": observer.px,
            "py_m": observer.py,
            "heading_rad": observer.yaw,
            "course_rad": np.where(speed > 0, np.arctan2(observer.vy, observer.vx), observer.yaw),
            "speed_mps": speed,
            "vx_mps": observer.vx,
            "vy_mps": observer.vy,
            "acceleration_mps2": np.gradient(speed, truth.time) if steps > 1 else np.zeros(steps),
            "yaw_rate_radps": observer.yaw_rate,
            "length_m": np.full(steps, observer.length),
            "width_m": np.full(steps, observer.width),
        }
    )
    table = stacked(parts)
    return table.set_column(table.schema.get_field_index("alive"), "alive", table["alive"].cast(pa.bool_()))


def measurements_table(scans: Sequence[Scan], ids: Sequence[str]) -> pa.Table:
    """Every measurement of the recorded run, with the position in the fixed frame that it states."""
    rows = len(ids)
    parts: list[Columns] = []
    for scan in scans:
        parts.append(
            {
                "sensor": [scan.sensor] * rows,
                "kind": [scan.kind] * rows,
                "object": list(ids),
                "time_s": np.full(rows, scan.time),
                "arrival_time_s": np.full(rows, scan.arrival_time),
                "valid": scan.valid.astype(float),
                **measurement_columns(scan),
            }
        )
    table = stacked(parts)
    return table.set_column(table.schema.get_field_index("valid"), "valid", table["valid"].cast(pa.bool_()))


def estimates_table(recorded: Mapping[str, RecordedEstimates], truth: Truth, instants: Indices, run: int) -> pa.Table:
    """Every tracker's estimates of one run at some steps of the truth, with their errors."""
    column = min(run, truth.px.shape[2] - 1)
    state = np.stack([truth.px, truth.py, truth.vx, truth.vy])[..., column][:, instants]
    rows = len(instants)
    parts: list[Columns] = []
    for name, of in recorded.items():
        error = of.mean - state
        nees = normalised_square(error, of.covariance)[0]
        for i, target in enumerate(truth.ids):
            parts.append(
                {
                    "tracker": [name] * rows,
                    "object": [target] * rows,
                    "time_s": truth.time[instants],
                    **state_columns(of.mean[:, :, i], of.covariance[:, :, :, i]),
                    "position_error_m": np.hypot(error[0, :, i], error[1, :, i]),
                    "velocity_error_mps": np.hypot(error[2, :, i], error[3, :, i]),
                    "nees": nees[:, i],
                    "due": of.due[:, i].astype(float),
                }
            )
    return stacked(parts)


def recorded_nis_table(
    recorded: Mapping[str, RecordedEstimates], ids: Sequence[str], sensor_times: Mapping[str, Array]
) -> pa.Table:
    """Normalised innovation squared of every measurement of the recorded run."""
    parts: list[Columns] = []
    for name, of in recorded.items():
        for sensor, values in of.nis.items():
            nis = np.stack(values)
            for i, target in enumerate(ids):
                rows = len(nis)
                parts.append(
                    {
                        "tracker": [name] * rows,
                        "sensor": [sensor] * rows,
                        "object": [target] * rows,
                        "time_s": sensor_times[sensor],
                        "nis": nis[:, i],
                    }
                )
    return stacked(parts)


def roads_table(truth: Truth) -> pa.Table:
    """Lane edges to draw."""
    return stacked(
        [
            {"line": np.full(len(line), float(i)), "x_m": line[:, 0], "y_m": line[:, 1]}
            for i, line in enumerate(truth.roads)
        ]
        or [{"line": np.zeros(0), "x_m": np.zeros(0), "y_m": np.zeros(0)}]
    )

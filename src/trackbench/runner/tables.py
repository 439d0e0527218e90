"""What a run leaves per step, per run and of the recorded run, as tables with a unit in each column's name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from trackbench.metrics.breakdown import cells
from trackbench.metrics.consistency import mean_bounds, normalised_square
from trackbench.metrics.scores import Scores
from trackbench.metrics.summary import ERROR, NIS_RUN, NIS_STEP
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.runner.block import RecordedEstimates, Work
from trackbench.types import Array, Indices, Scan, Truth

Columns = dict[str, Array | list[str]]


def steps_table(scores: Mapping[str, Scores], bounds: Mapping[str, Array], time: Array) -> pa.Table:
    """Errors of each tracker at each instant over runs and objects, with the Cramer-Rao bound."""
    return _stacked([_steps(name, item, bounds[name], time) for name, item in scores.items()])


def nis_table(scores: Mapping[str, Scores], sensor_times: Mapping[str, Array]) -> pa.Table:
    """Normalised innovation squared of each tracker and sensor at each measurement."""
    parts = []
    for name, item in scores.items():
        for sensor, nis in item.nis.items():
            if nis.dof == 0:
                continue
            count = nis.per_step[NIS_STEP["count"]]
            low, high = mean_bounds(nis.dof, count)
            rows = len(count)
            parts.append(
                {
                    "tracker": [name] * rows,
                    "sensor": [sensor] * rows,
                    "time_s": sensor_times[sensor],
                    "count": count,
                    "nis_mean": _mean(nis.per_step[NIS_STEP["nis"]], count),
                    "nis_low": np.where(count > 0, low, np.nan),
                    "nis_high": np.where(count > 0, high, np.nan),
                    "dof": np.full(rows, float(nis.dof)),
                    "inside95": _mean(nis.per_step[NIS_STEP["inside"]], count),
                }
            )
    return _stacked(parts)


def runs_table(scores: Mapping[str, Scores]) -> pa.Table:
    """Errors of each tracker in each run, for paired comparisons."""
    parts = []
    for name, item in scores.items():
        count = item.per_run[ERROR["count"]]
        rows = len(count)
        parts.append(
            {
                "tracker": [name] * rows,
                "run": np.arange(rows, dtype=float),
                "count": count,
                "course_count": item.per_run[ERROR["course_count"]],
                **_errors(item.per_run),
                "nees_mean": _mean(item.per_run[ERROR["nees"]], count),
                "nis_mean": _mean(*_all_nis(item)),
                "diverged": item.diverged,
                "repaired": item.repaired,
            }
        )
    return _stacked(parts)


def breakdown_table(scores: Mapping[str, Scores]) -> pa.Table:
    """Errors of each tracker in each manoeuvre and range band over all runs."""
    rows = [{"tracker": name, **cell} for name, item in scores.items() for cell in cells(item.classes)]
    return pa.Table.from_pylist(rows)


def autocorrelation_table(scores: Mapping[str, Scores]) -> pa.Table:
    """Autocorrelation of each tracker's whitened innovations over all runs, by lag in measurements.

    ``low`` and ``high`` hold 95 % of the values where the innovations are white.
    """
    parts: list[Columns] = []
    for name, item in scores.items():
        for sensor, nis in item.nis.items():
            pairs, product, square = nis.lags
            if nis.dof == 0 or square[0] == 0:
                continue
            reach = 1.96 / np.sqrt(np.where(pairs > 0, pairs, np.nan) * nis.dof)
            parts.append(
                {
                    "tracker": [name] * len(pairs),
                    "sensor": [sensor] * len(pairs),
                    "lag": np.arange(len(pairs), dtype=float),
                    "pairs": pairs,
                    "correlation": product / np.where(square > 0, square, np.nan),
                    "low": -reach,
                    "high": reach,
                }
            )
    return _stacked(parts)


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
    table = _stacked(parts)
    return table.set_column(table.schema.get_field_index("alive"), "alive", table["alive"].cast(pa.bool_()))


def measurements_table(scans: Sequence[Scan], ids: Sequence[str]) -> pa.Table:
    """Every measurement of the recorded run, with the position in the fixed frame that it states."""
    rows = len(ids)
    parts: list[Columns] = []
    for scan in scans:
        position = SENSOR_MODELS[scan.kind].position(scan).mean
        third = scan.measurement[2] if len(scan.measurement) > 2 else np.full(rows, np.nan)
        parts.append(
            {
                "sensor": [scan.sensor] * rows,
                "kind": [scan.kind] * rows,
                "object": list(ids),
                "time_s": np.full(rows, scan.time),
                "arrival_time_s": np.full(rows, scan.arrival_time),
                "valid": scan.valid.astype(float),
                "z0": scan.measurement[0],
                "z1": scan.measurement[1],
                "z2": third,
                "x_m": position[0],
                "y_m": position[1],
                "sensor_x_m": np.full(rows, scan.sensor_pose[0]),
                "sensor_y_m": np.full(rows, scan.sensor_pose[1]),
                "sensor_yaw_rad": np.full(rows, scan.sensor_pose[2]),
            }
        )
    table = _stacked(parts)
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
            mean, covariance = of.mean[:, :, i], of.covariance[:, :, :, i]
            parts.append(
                {
                    "tracker": [name] * rows,
                    "object": [target] * rows,
                    "time_s": truth.time[instants],
                    **dict(zip(("px_m", "py_m", "vx_mps", "vy_mps"), mean, strict=True)),
                    **{f"p_{a}{b}": covariance[a, b] for a in range(4) for b in range(a, 4)},
                    "position_error_m": np.hypot(error[0, :, i], error[1, :, i]),
                    "velocity_error_mps": np.hypot(error[2, :, i], error[3, :, i]),
                    "nees": nees[:, i],
                }
            )
    return _stacked(parts)


def recorded_nis_table(
    recorded: Mapping[str, RecordedEstimates], work: Work, sensor_times: Mapping[str, Array]
) -> pa.Table:
    """Normalised innovation squared of every measurement of the recorded run."""
    parts: list[Columns] = []
    for name, of in recorded.items():
        for sensor, values in of.nis.items():
            nis = np.stack(values)
            for i, target in enumerate(work.truth.ids):
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
    return _stacked(parts)


def roads_table(truth: Truth) -> pa.Table:
    """Lane edges to draw."""
    return _stacked(
        [
            {"line": np.full(len(line), float(i)), "x_m": line[:, 0], "y_m": line[:, 1]}
            for i, line in enumerate(truth.roads)
        ]
        or [{"line": np.zeros(0), "x_m": np.zeros(0), "y_m": np.zeros(0)}]
    )


def _steps(name: str, scores: Scores, variances: Array, time: Array) -> Columns:
    count = scores.per_step[ERROR["count"]]
    weight = np.where(np.isfinite(variances).all(axis=2), scores.weight, 0.0)
    total = weight.sum(axis=1)
    mean = np.einsum("to,toc->tc", weight, np.nan_to_num(variances)) / np.where(total > 0, total, np.nan)[:, None]
    low, high = mean_bounds(4, count)
    return {
        "tracker": [name] * len(time),
        "time_s": time,
        "count": count,
        **_errors(scores.per_step),
        "position_p10_m": scores.spread[0],
        "position_p90_m": scores.spread[1],
        "nees_mean": _mean(scores.per_step[ERROR["nees"]], count),
        "nees_low": np.where(count > 0, low, np.nan),
        "nees_high": np.where(count > 0, high, np.nan),
        "position_bound_m": np.sqrt(mean[:, :2].sum(axis=1)),
        "velocity_bound_mps": np.sqrt(mean[:, 2:].sum(axis=1)),
    }


def _errors(sums: Array) -> Columns:
    count, course_count = sums[ERROR["count"]], sums[ERROR["course_count"]]

    def rms(*rows: str) -> Array:
        return np.sqrt(_mean(sum((sums[ERROR[row]] for row in rows), np.zeros_like(count)), count))

    return {
        "position_rmse_m": rms("px", "py"),
        "velocity_rmse_mps": rms("vx", "vy"),
        "course_rmse_deg": np.rad2deg(np.sqrt(_mean(sums[ERROR["course"]], course_count))),
        "px_rmse_m": rms("px"),
        "py_rmse_m": rms("py"),
        "vx_rmse_mps": rms("vx"),
        "vy_rmse_mps": rms("vy"),
    }


def _all_nis(scores: Scores) -> tuple[Array, Array]:
    nothing = np.zeros_like(scores.present)
    total = sum((nis.per_run[NIS_RUN["nis"]] for nis in scores.nis.values()), nothing)
    return total, sum((nis.per_run[NIS_RUN["count"]] for nis in scores.nis.values()), nothing)


def _mean(total: Array, count: Array) -> Array:
    return total / np.where(count > 0, count, np.nan)


def _stacked(parts: Sequence[Columns]) -> pa.Table:
    if not parts:
        return pa.table({})
    joined: dict[str, pa.Array] = {}
    for key in parts[0]:
        values = [part[key] for part in parts]
        if isinstance(values[0], list):
            joined[key] = pa.array([text for part in values for text in part]).dictionary_encode()
        else:
            joined[key] = pa.array(np.concatenate(values), from_pandas=True)
    return pa.table(joined)

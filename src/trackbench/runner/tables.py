"""What all runs leave per step, per run and by condition, as tables with a unit in each column's name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from trackbench.metrics import Evaluation
from trackbench.metrics.breakdown import cells
from trackbench.metrics.consistency import mean_bounds
from trackbench.metrics.stored import run_column
from trackbench.metrics.sums import ERROR, NIS_RUN, NIS_STEP, Scores
from trackbench.runner.columns import Columns, stacked
from trackbench.types import Array


def steps_table(scores: Mapping[str, Scores], bounds: Mapping[str, Array], time: Array) -> pa.Table:
    """Errors of each tracker at each instant over runs and objects, with the Cramer-Rao bound."""
    return stacked([_steps(name, item, bounds[name], time) for name, item in scores.items()])


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
    return stacked(parts)


def runs_table(scores: Mapping[str, Scores], evaluations: Mapping[str, Evaluation]) -> pa.Table:
    """Errors of each tracker in each run, for paired comparisons, and what it adds to each metric of a plug-in."""
    parts = []
    own = list(dict.fromkeys(path for item in evaluations.values() for path in item.own))
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
                **{run_column(path): evaluations[name].per_run(path, rows) for path in own},
            }
        )
    return stacked(parts)


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
    return stacked(parts)


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

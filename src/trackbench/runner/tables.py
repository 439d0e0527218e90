"""What all runs leave per step, per run and by condition, as tables with a unit in each column's name."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from trackbench.base.types import Array, Indices
from trackbench.metrics import Evaluation
from trackbench.metrics.breakdown import cells
from trackbench.metrics.consistency import mean_bounds
from trackbench.metrics.protocol import run_column
from trackbench.metrics.sums import ERROR, NIS, BlockScores, Scores
from trackbench.runner.columns import Columns, stacked
from trackbench.runner.evaluated import Evaluated


def steps_table(evaluations: Mapping[str, Evaluation], time: Array) -> pa.Table:
    """Errors of each tracker at each instant over runs and objects, with the reference."""
    return stacked([_steps(name, item.scores, time) for name, item in evaluations.items()])


def nis_table(scores: Mapping[str, BlockScores], sensor_times: Mapping[str, Array]) -> pa.Table:
    """Normalised innovation squared of each tracker and sensor at each measurement."""
    parts = []
    for name, item in scores.items():
        for sensor, nis in item.nis.items():
            if nis.dof == 0:
                continue
            count = nis.per_step[NIS["count"]]
            low, high = mean_bounds(nis.dof, count)
            rows = len(count)
            parts.append(
                {
                    "tracker": [name] * rows,
                    "sensor": [sensor] * rows,
                    "time_s": sensor_times[sensor],
                    "count": count,
                    "nis_mean": _mean(nis.per_step[NIS["nis"]], count),
                    "nis_low": np.where(count > 0, low, np.nan),
                    "nis_high": np.where(count > 0, high, np.nan),
                    "dof": np.full(rows, float(nis.dof)),
                    "inside95": _mean(nis.per_step[NIS["inside"]], count),
                }
            )
    return stacked(parts)


def runs_table(found: Evaluated, scene: Indices) -> pa.Table:
    """Errors of each tracker in each run, for paired comparisons, and what it adds to each metric of a plug-in.

    Args:
        found: what the trackers reached.
        scene: ``(runs,)`` number of the scene of each run.
    """
    parts = []
    own = list(dict.fromkeys(path for item in found.evaluations.values() for path in item.own))
    for name, item in found.scores.items():
        per_run = found.evaluations[name].scores.per_run
        rows = len(scene)
        parts.append(
            {
                "tracker": [name] * rows,
                "run": np.arange(rows, dtype=float),
                "scene": scene.astype(float),
                "count": per_run[ERROR["count"]],
                "course_count": per_run[ERROR["course_count"]],
                "due": item.due,
                **_errors(per_run),
                "nees_mean": _mean(per_run[ERROR["nees"]], per_run[ERROR["count"]]),
                "nis_mean": _mean(*_all_nis(item)),
                "position_reference_m": _mean_root(per_run, "position_reference"),
                "velocity_reference_mps": _mean_root(per_run, "velocity_reference"),
                "diverged": item.diverged,
                "repaired": item.repaired,
                **{run_column(path): found.evaluations[name].per_run(path, rows) for path in own},
            }
        )
    return stacked(parts)


def breakdown_table(evaluations: Mapping[str, Evaluation]) -> pa.Table:
    """Errors of each tracker in each manoeuvre and range band over all runs."""
    rows = [{"tracker": name, **cell} for name, item in evaluations.items() for cell in cells(item.scores.classes)]
    return pa.Table.from_pylist(rows)


def autocorrelation_table(scores: Mapping[str, BlockScores]) -> pa.Table:
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


def _steps(name: str, scores: Scores, time: Array) -> Columns:
    count = scores.per_step[ERROR["count"]]
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
        "position_reference_m": _mean_root(scores.per_step, "position_reference"),
        "velocity_reference_mps": _mean_root(scores.per_step, "velocity_reference"),
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


def _mean_root(sums: Array, row: str) -> Array:
    """NaN where there is none."""
    total = sums[ERROR[row]]
    return np.sqrt(_mean(np.where(total > 0, total, np.nan), sums[ERROR["count"]]))


def _all_nis(scores: BlockScores) -> tuple[Array, Array]:
    nothing = np.zeros_like(scores.due)
    total = sum((nis.per_run[NIS["nis"]] for nis in scores.nis.values()), nothing)
    return total, sum((nis.per_run[NIS["count"]] for nis in scores.nis.values()), nothing)


def _mean(total: Array, count: Array) -> Array:
    return total / np.where(count > 0, count, np.nan)

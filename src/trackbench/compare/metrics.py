"""The metrics that have a value in each run, and where the runs' table keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from trackbench.errors import InputError, nearest


@dataclass(frozen=True)
class PerRunMetric:
    """A metric of which ``runs.parquet`` holds the value of each run."""

    column: str
    count: str
    """Column with the number of terms of each run's value."""
    unit: str
    squared: bool = True
    """Whether the value is a root mean square; else it is a mean."""
    better: Literal["smaller", "larger", ""] = "smaller"
    over: str = ""
    """Metric that it is divided by, of which there is one value for all runs."""


METRICS = {
    "position_rmse": PerRunMetric("position_rmse_m", "count", "m"),
    "velocity_rmse": PerRunMetric("velocity_rmse_mps", "count", "m/s"),
    "course_rmse": PerRunMetric("course_rmse_deg", "course_count", "deg"),
    "rmse.px": PerRunMetric("px_rmse_m", "count", "m"),
    "rmse.py": PerRunMetric("py_rmse_m", "count", "m"),
    "rmse.vx": PerRunMetric("vx_rmse_mps", "count", "m/s"),
    "rmse.vy": PerRunMetric("vy_rmse_mps", "count", "m/s"),
    "position_efficiency": PerRunMetric("position_rmse_m", "count", "1", over="position_bound"),
    "velocity_efficiency": PerRunMetric("velocity_rmse_mps", "count", "1", over="velocity_bound"),
    "nees.mean": PerRunMetric("nees_mean", "count", "1", squared=False, better=""),
}


def require_metric(metric: str, key: str) -> PerRunMetric:
    """A metric by its path.

    Raises:
        InputError: it has no value in each run.
    """
    if metric not in METRICS:
        raise InputError(f"{metric!r} is not compared run by run; {nearest(metric, METRICS)}", key=key)
    return METRICS[metric]

"""Metrics from the table of runs of a stored result."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.builtin import BUILT_IN, RootMeanSquare
from trackbench.metrics.intervals import Interval, ratio, root


class SummedMetric(Protocol):
    """A metric of tracking in traffic, as far as its interval depends on it."""

    @property
    def combine(self) -> str: ...
    @property
    def at_least(self) -> float: ...
    @property
    def at_most(self) -> float: ...


ROOT_MEAN_SQUARES = {metric.name: metric for metric in BUILT_IN if isinstance(metric, RootMeanSquare)}


def run_column(path: str) -> str:
    """Where the table of runs holds what each run has of a metric."""
    return ROOT_MEAN_SQUARES[path].column if path in ROOT_MEAN_SQUARES else own_column(path)


def own_column(path: str) -> str:
    """The same of a metric that is not built in; the mean of the column is the metric."""
    return f"{path}_per_run"


def sum_columns(path: str) -> tuple[str, str]:
    """Where it holds the total and the count of a metric of tracking in traffic."""
    return f"{path}_total", f"{path}_count"


def from_sums(metric: SummedMetric, total: Array, count: Array) -> Interval:
    """Such a metric from the total and the count of each run ``(runs,)``: their ratio, or its root."""
    found = ratio(total, count, at_least=metric.at_least, at_most=metric.at_most)
    return root(found) if metric.combine == "root" else found


def count_column(path: str) -> str | None:
    """Where it holds the number of terms of each run; None where every run counts alike."""
    return ROOT_MEAN_SQUARES[path].count if path in ROOT_MEAN_SQUARES else None


def from_runs(path: str, values: Array, count: Array | None = None) -> Interval | None:
    """A metric from its columns ``(runs,)`` of the table of runs; None where no run bears on it."""
    if path in ROOT_MEAN_SQUARES and count is not None:
        return ROOT_MEAN_SQUARES[path].of_runs(values, count)
    return ratio(values, np.ones(len(values))) if np.isfinite(values).all() else None

"""The metrics that are compared: those that have a value in each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics import registry, stored
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Direction
from trackbench.metrics.traffic import METRICS, TrafficMetric
from trackbench.results.score_summary import OwnMetricSummary

#: Metrics that are another one over that of the reference, and the column of the reference.
_OVER = {
    "position_over_reference": ("position_rmse", "position_reference_m"),
    "velocity_over_reference": ("velocity_rmse", "velocity_reference_mps"),
}
_NEES = "nees.mean"
BUILT_IN = {*stored.ROOT_MEAN_SQUARES, *_OVER, _NEES}


@dataclass(frozen=True)
class ComparedMetric:
    """A metric of which ``runs.parquet`` holds the value of each run."""

    path: str
    unit: str
    better: Direction | None
    """Which values are better; None where neither is."""
    own: bool = False
    """Whether it is not built in: the mean of its column is the metric."""
    of_tracks: TrafficMetric | None = None
    """Where identities are hidden, how its totals and counts combine."""

    @property
    def over(self) -> str:
        """Column of the reference that it is divided by, empty where it is by none."""
        return "" if self.own else _OVER.get(self.path, ("", ""))[1]

    @property
    def column(self) -> str:
        """Of its values."""
        if self.of_tracks:
            return stored.sum_columns(self.path)[0]
        if self.own:
            return stored.own_column(self.path)
        return "nees_mean" if self.path == _NEES else stored.run_column(self._numerator)

    @property
    def count(self) -> str | None:
        """Column of the number of terms of each; None where every run counts alike."""
        if self.of_tracks:
            return stored.sum_columns(self.path)[1]
        if self.own:
            return None
        return "count" if self.path == _NEES else stored.count_column(self._numerator)

    @property
    def _numerator(self) -> str:
        return _OVER.get(self.path, (self.path, ""))[0]

    def of_runs(self, values: Array, count: Array, reference: Array | None) -> Interval | None:
        """The metric of some runs; None where there is nothing to compare.

        Args:
            values: ``(runs,)`` the column.
            count: ``(runs,)`` the number of terms of each.
            reference: ``(runs,)`` what it is divided by; None where it is by none.
        """
        if self.of_tracks:
            return stored.from_sums(self.of_tracks, values, count) if count.any() else None
        if self.own:
            return ratio(values, np.ones(len(values))) if np.isfinite(values).all() else None
        if self.path == _NEES:
            return ratio(np.nan_to_num(values) * count, count, at_least=0.0) if count.sum() > 0 else None
        if reference is not None:
            squares, over = (np.nan_to_num(each) ** 2 * count for each in (values, reference))
            return root(ratio(squares, over)) if over.sum() > 0 else None
        return stored.from_runs(self._numerator, values, count)


def compared_metrics(own: Sequence[OwnMetricSummary], *, built_in: bool) -> dict[str, ComparedMetric]:
    """Those that have a value in each run, by path: the results' own, and beside them the built-in ones or none."""
    found = [ComparedMetric(item.path, item.unit, item.better) for item in registry.known()]
    found = [metric for metric in found if metric.path in BUILT_IN and built_in]
    for item in own:
        if not item.per_sensor:
            of_tracks = None if built_in else METRICS.get(item.name)
            found.append(ComparedMetric(item.name, item.unit, item.better, of_tracks is None, of_tracks))
    return {metric.path: metric for metric in found}

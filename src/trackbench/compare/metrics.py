"""The metrics that are compared: those that have a value in each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.errors import InputError, nearest
from trackbench.metrics import registry, stored
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Direction
from trackbench.results.summary import OwnMetricSummary
from trackbench.types import Array

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

    @property
    def over(self) -> str:
        """Column of the reference that it is divided by, empty where it is by none."""
        return "" if self.own else _OVER.get(self.path, ("", ""))[1]

    @property
    def column(self) -> str:
        """Of its values."""
        if self.own:
            return stored.own_column(self.path)
        return "nees_mean" if self.path == _NEES else stored.run_column(self._numerator)

    @property
    def count(self) -> str | None:
        """Column of the number of terms of each; None where every run counts alike."""
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
        if self.own:
            return ratio(values, np.ones(len(values))) if np.isfinite(values).all() else None
        if self.path == _NEES:
            return ratio(np.nan_to_num(values) * count, count, at_least=0.0) if count.sum() > 0 else None
        if reference is not None:
            squares, over = (np.nan_to_num(each) ** 2 * count for each in (values, reference))
            return root(ratio(squares, over)) if over.sum() > 0 else None
        return stored.from_runs(self._numerator, values, count)


def compared_metric(
    path: str, key: str, own: Sequence[OwnMetricSummary] = (), *, built_in: bool = True
) -> ComparedMetric:
    """A metric by its path; ``own`` are those that are not built in, beside which there may be none.

    Raises:
        InputError: it has no value in each run; ``key`` is the option that names it.
    """
    found = {item.path: ComparedMetric(item.path, item.unit, item.better) for item in registry.known()}
    known = {name: metric for name, metric in found.items() if name in BUILT_IN and built_in}
    known |= {item.name: ComparedMetric(item.name, item.unit, item.better, True) for item in own if not item.per_sensor}
    if path not in known:
        raise InputError(f"{path!r} is not compared run by run; {nearest(path, known)}", key=key)
    return known[path]

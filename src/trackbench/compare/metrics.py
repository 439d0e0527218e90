"""The metrics that are compared: those that have a value in each run."""

from __future__ import annotations

from collections.abc import Sequence
from types import new_class
from typing import Any, NoReturn

from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.results.score_summary import MetricSummary


class StoredMetric(Metric):
    """A metric of a result whose class need not be here: the mean of its column in the table of runs."""

    def finish(self, sums: Any) -> NoReturn:
        raise NotImplementedError


def compared_metrics(own: Sequence[MetricSummary], *, built_in: bool) -> dict[str, Metric]:
    """Those that have a value in each run, by path: the results' own, and beside them the built-in ones or none."""
    metrics: list[Metric] = [metric for metric in BUILT_IN if metric.columns] if built_in else []
    for item in own:
        if not item.per_sensor:
            of_tracks = None if built_in else TRACK_METRICS.get(item.name)
            metrics.append(of_tracks or stored_metric(item))
    return {metric.path: metric for metric in metrics}


def stored_metric(summary: MetricSummary) -> StoredMetric:
    """A metric as a result describes it."""
    members = {name: getattr(summary, name) for name in ("name", "unit", "meaning", "better", "compared")}
    members["__module__"] = __name__
    metric: StoredMetric = new_class(summary.name, (StoredMetric,), {}, lambda body: body.update(members))()
    return metric

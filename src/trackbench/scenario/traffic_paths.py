"""What an expectation may name where identities are hidden."""

from __future__ import annotations

from trackbench.metrics.registry import HEALTH, MetricPath
from trackbench.metrics.traffic import METRICS
from trackbench.metrics.traffic.without_truth import METRICS_WITHOUT_TRUTH


def traffic_paths(truth: bool) -> dict[str, MetricPath]:
    """By path, the metrics of tracks with a truth or without one."""
    found = {}
    for path, metric in (METRICS if truth else METRICS_WITHOUT_TRUTH).items():
        better = None if metric.better == "none" else metric.better
        found[path] = MetricPath(path, metric.unit or "1", metric.meaning, better=better, compared=better is not None)
    reused = HEALTH + "reused_ids"
    return {**found, reused: MetricPath(reused, "1", "identities that were used again after their track had ended")}

"""What an expectation may name where identities are hidden."""

from __future__ import annotations

from trackbench.metrics import Field
from trackbench.metrics.registry import HEALTH
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.without_truth import DETECTION_METRICS


def traffic_paths(truth: bool) -> dict[str, Field]:
    """By path, the metrics of tracks with a truth or without one."""
    metrics = TRACK_METRICS if truth else DETECTION_METRICS
    found = {field.name: field for metric in metrics.values() for field in metric.entries()}
    reused = HEALTH + "reused_ids"
    return {**found, reused: Field(reused, "identities that were used again after their track had ended")}

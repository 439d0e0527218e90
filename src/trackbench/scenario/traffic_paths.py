"""What an expectation may name where identities are hidden."""

from __future__ import annotations

from collections.abc import Iterable

from trackbench.metrics import Field, Metric
from trackbench.metrics.registry import HEALTH, entries
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.without_truth import DETECTION_METRICS


def traffic_paths(truth: bool, own: Iterable[Metric | type[Metric]] = ()) -> dict[str, Field]:
    """By path, the metrics of tracks with a truth or without one, and others."""
    metrics = [*(TRACK_METRICS if truth else DETECTION_METRICS).values(), *own]
    found = {field.name: field for metric in metrics for field in entries(metric)}
    reused = HEALTH + "reused_ids"
    return {**found, reused: Field(reused, "identities that were used again after their track had ended")}

"""Every metric: those that each run has, and those that a scenario names; and what an expectation may name of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from trackbench.base.plugins import Registry
from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.protocol import SENSOR, Field, Metric

#: Paths that begin so are of a tracker's health, beside its metrics.
HEALTH = "health."
NAME = re.compile(r"[a-z][a-z0-9_]*")

#: By whether identities are hidden.
_HEALTH = {
    False: (
        Field(HEALTH + "diverged_runs", "runs whose position error exceeded score.divergence_m"),
        Field(HEALTH + "repaired_covariances", "covariances that had to be made positive definite again"),
        Field(HEALTH + "repaired_runs", "runs in which that happened"),
        Field(HEALTH + "non_finite_estimates", "estimates with NaN or infinity"),
    ),
    True: (Field(HEALTH + "reused_ids", "identities that were used again after their track had ended"),),
}


def built_in_metrics(hidden: bool, truth: bool = True) -> tuple[Metric, ...]:
    """The metrics of every run with known or hidden identities; ``truth``: whether there is one."""
    if not hidden:
        return BUILT_IN
    # The scores of tracks take their time to import.
    from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS

    return tuple((TRACK_METRICS if truth else DETECTION_METRICS).values())


def ranking_path(metrics: Iterable[Metric]) -> str:
    """The path of the metric that trackers are ranked by."""
    return next(metric.path for metric in metrics if metric.ranks)


def metric_paths(own: Iterable[Metric | type[Metric]] = (), hidden: bool = False, truth: bool = True) -> list[Field]:
    """What an expectation may name of the built-in metrics, as :func:`built_in_metrics`, and of others."""
    metrics = (*built_in_metrics(hidden, truth), *own)
    return [*(field for metric in metrics for field in _metric_fields(metric)), *_HEALTH[hidden]]


def by_path(
    sensors: Iterable[str], own: Sequence[Metric] = (), hidden: bool = False, truth: bool = True
) -> dict[str, Field]:
    """Every path that an expectation may name in a scenario with these sensors."""
    names = list(sensors)
    return {
        path: field
        for field in metric_paths(own, hidden, truth)
        for path in ([field.name.replace(SENSOR, name) for name in names] if field.per_sensor else [field.name])
    }


def _metric_fields(metric: Metric | type[Metric]) -> list[Field]:
    """What an expectation may name of a metric, or of one whose options are not known."""
    return metric.entries() if isinstance(metric, Metric) else metric.model_construct().entries()


def unfit_name(name: str, scores: str = "estimates") -> str | None:
    """Why no metric of one's own can have this name; None if one can. ``scores``: what it is of."""
    if not NAME.fullmatch(name):
        return f"its name {name!r} may have a to z, 0 to 9 and _ alone"
    if name in {"health", "step_time", *(item.name.partition(".")[0] for item in built_in_metrics(scores == "tracks"))}:
        return f"its name {name!r} is that of a built-in one"
    return None


def _lacks(metric: Any) -> str | None:
    if not isinstance(metric, type) or not issubclass(metric, Metric):
        return "it must be a subclass of trackbench.metrics.Metric"
    missing = [name for name in ("name", "unit", "meaning") if not hasattr(metric, name)]
    unwritten = set(getattr(metric, "__abstractmethods__", ()))
    if metric.shared is None:
        unwritten |= {name for name in ("init", "update", "merge") if getattr(metric, name) is getattr(Metric, name)}
    missing += sorted(unwritten)
    if missing:
        return f"it lacks {' and '.join(missing)}"
    texts = {name: getattr(metric, name) for name in ("name", "unit", "meaning", "value_name")}
    for name, value in texts.items():
        if not isinstance(value, str):
            return f"its {name} must be text, not {value!r}"
    for name in ("compared", "per_sensor"):
        if not isinstance(getattr(metric, name), bool):
            return f"its {name} must be True or False, not {getattr(metric, name)!r}"
    if not isinstance(metric.fields, tuple) or not all(isinstance(field, Field) for field in metric.fields):
        return f"its fields must be a tuple of trackbench.metrics.Field, not {metric.fields!r}"
    if metric.scores not in ("estimates", "tracks"):
        return f'scores must be "estimates" or "tracks", not {metric.scores!r}'
    if unfit := unfit_name(metric.name, metric.scores):
        return unfit
    if metric.better not in ("smaller", "larger", None):
        return f'better must be "smaller", "larger" or None, not {metric.better!r}'
    return None


#: The metrics beside the built-in ones, by the names that scenarios use.
METRICS: Registry[type[Metric]] = Registry("trackbench.metrics", "metric", _lacks)

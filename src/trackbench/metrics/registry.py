"""All metrics, built in and of plug-ins, and the values and verdicts that a scenario's expectation can name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Set
from typing import Any

from trackbench.base.plugins import Registry, lacks_class
from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.protocol import PROPERTIES, SENSOR, Field, Metric
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS

#: Path prefix of a tracker's health, which stands beside its metrics.
HEALTH = "health."
NAME = re.compile(r"[a-z][a-z0-9_]*")

_HEALTH = (
    Field(HEALTH + "diverged_runs", "runs whose position error exceeded score.divergence_m", needs={"labels"}),
    Field(HEALTH + "repaired_covariances", "covariances made positive definite again", needs={"labels"}),
    Field(HEALTH + "repaired_runs", "runs in which a covariance was repaired", needs={"labels"}),
    Field(HEALTH + "non_finite_estimates", "estimates with NaN or infinity", needs={"labels"}),
    Field(HEALTH + "reused_ids", "identities that were used again after their track had ended", needs={"tracks"}),
)
#: Every built-in metric. Two with the same name are one metric, over estimates and over tracks.
_EVERY: tuple[Metric, ...] = (*BUILT_IN, *TRACK_METRICS.values(), *DETECTION_METRICS.values())


def metrics_for(properties: Set[str]) -> tuple[Metric, ...]:
    """Return the built-in metrics of a scenario with these properties, such as ``labels`` and ``truth``."""
    return tuple(metric for metric in _EVERY if metric.needs <= properties)


def ranking_path(metrics: Iterable[Metric]) -> str:
    """Return the dotted path of the metric among ``metrics`` that ranks trackers by default."""
    return next(metric.path for metric in metrics if metric.ranks)


def metric_paths(own: Iterable[Metric | type[Metric]] = (), properties: Set[str] = PROPERTIES) -> list[Field]:
    """Return every value and verdict of the metrics that a scenario's expectation can name, without repetition.

    Args:
        own: metrics of plug-ins, added to the built-in metrics.
        properties: properties of the scenarios: ``labels`` or ``tracks``, ``truth`` or ``no truth``.
    """
    fields: dict[str, Field] = {}
    every = (metric if isinstance(metric, Metric) else metric.model_construct() for metric in (*_EVERY, *own))
    for field in (*(field for metric in every for field in metric.entries()), *_HEALTH):
        if field.needs <= properties:
            same = fields.get(field.name, field)
            fields[field.name] = same._replace(needs=same.needs & field.needs)
    return list(fields.values())


def by_path(sensors: Iterable[str], own: Iterable[Metric] = (), properties: Set[str] = PROPERTIES) -> dict[str, Field]:
    """Return, by dotted path, every value that an expectation can name in a scenario with these sensors."""
    names = list(sensors)
    return {
        path: field
        for field in metric_paths(own, properties)
        for path in ([field.name.replace(SENSOR, name) for name in names] if field.per_sensor else [field.name])
    }


def unfit_name(name: str) -> str | None:
    """Return why a user's metric cannot have this name; None if it can."""
    if not NAME.fullmatch(name):
        return f"its name {name!r} may only have a to z, 0 to 9 and _"
    if name in {"health", *(item.name.partition(".")[0] for item in _EVERY)}:
        return f"its name {name!r} is that of a built-in one"
    return None


def _lacks(metric: Any) -> str | None:
    if incomplete := lacks_class(Metric)(metric):
        return incomplete
    unwritten = [name for name in ("init", "update", "merge") if getattr(metric, name) is getattr(Metric, name)]
    if metric.shared is None and unwritten:
        return f"it lacks {' and '.join(unwritten)}"
    for name in ("name", "unit", "meaning"):
        if not isinstance(value := getattr(metric, name), str):
            return f"its {name} must be text, not {value!r}"
    if not isinstance(metric.needs, Set) or not metric.needs <= PROPERTIES:
        return f"its needs must be a set of {', '.join(sorted(PROPERTIES))}, not {metric.needs!r}"
    if unfit := unfit_name(metric.name):
        return unfit
    if metric.better not in ("smaller", "larger", None):
        return f'better must be "smaller", "larger" or None, not {metric.better!r}'
    return None


#: Metrics beside the built-in ones, by the names that scenarios use.
METRICS: Registry[type[Metric]] = Registry("trackbench.metrics", "metric", _lacks)

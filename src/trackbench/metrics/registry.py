"""Every metric by the paths under which an expectation names it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from trackbench.metrics.builtin import BUILT_IN
from trackbench.metrics.protocol import Direction, Metric

#: Paths that begin so are of a tracker's health, beside its metrics.
HEALTH = "health."
SENSOR = "<sensor>"

_HEALTH_MEANINGS = {
    "diverged_runs": "runs whose position error exceeded score.divergence_m",
    "repaired_covariances": "covariances that had to be made positive definite again",
    "repaired_runs": "runs in which that happened",
    "non_finite_estimates": "estimates with NaN or infinity",
}


@dataclass(frozen=True)
class MetricPath:
    """What an expectation may name: the value of a metric, or a part of it."""

    path: str
    """``<sensor>`` stands for a sensor's name."""
    unit: str
    """ "1" for a number without a unit, "" for a word."""
    meaning: str
    words: tuple[str, ...] = ()
    """The values of a verdict; empty for a number."""
    better: Direction | None = None
    compared: bool = False
    """Whether two trackers are compared by it, run by run (``better_than``)."""

    @property
    def per_sensor(self) -> bool:
        return SENSOR in self.path


def known(own: Sequence[Metric | type[Metric]] = ()) -> list[MetricPath]:
    """Every path of the built-in metrics and of others."""
    health = [MetricPath(HEALTH + name, "1", meaning) for name, meaning in _HEALTH_MEANINGS.items()]
    return [*(path for metric in (*BUILT_IN, *own) for path in _paths(metric)), *health]


def by_path(sensors: Iterable[str], own: Sequence[Metric] = ()) -> dict[str, MetricPath]:
    """Every path that an expectation may name in a scenario with these sensors."""
    names = list(sensors)
    return {
        path: metric
        for metric in known(own)
        for path in ([metric.path.replace(SENSOR, name) for name in names] if metric.per_sensor else [metric.path])
    }


def _paths(metric: Metric | type[Metric]) -> list[MetricPath]:
    path = f"{metric.name}.{SENSOR}" if metric.per_sensor else metric.name
    value = f"{path}.{metric.value_name}" if metric.value_name else path
    compared = metric.compared and metric.better is not None
    return [
        MetricPath(value, metric.unit, metric.meaning, better=metric.better, compared=compared),
        *(
            MetricPath(f"{path}.{field.name}", "" if field.words else "1", field.meaning, field.words)
            for field in metric.fields
        ),
    ]

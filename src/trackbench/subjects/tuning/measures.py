"""The sums that a trial leaves, by run: errors, and the log-likelihood of innovations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics import Metric, evaluate, merge_sums
from trackbench.metrics.built_in.basic import Coverage
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.intervals import Interval, clustered
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.table import run_ratio
from trackbench.metrics.verdicts import LEAST_COVERAGE

#: Measures that the sums of a trial give, by name; the metric of the objective is one more.
MEASURES: dict[str, Metric] = {
    **TRACK_METRICS,
    "log_likelihood": run_ratio("log_likelihood", "1", "log-likelihood of a measurement", "larger", at_least=-math.inf),
}
#: Names of the measures of every trial, and of the further measures of tracks.
OF_ALL = ("position_rmse", "velocity_rmse", "nees", "log_likelihood")
OF_TRACKS = ("tgospa", "gospa_switch", "gospa", "gospa_localisation", "gospa_missed", "gospa_false")


class _Words(dict[str, str]):
    def __missing__(self, measure: str) -> str:
        return measure.replace("_", " ")


#: Name of each measure in sentences.
WORDS = _Words(
    position_rmse="position RMSE",
    velocity_rmse="velocity RMSE",
    nees="mean NEES",
    log_likelihood="log-likelihood of a measurement",
    tgospa="T-GOSPA",
    gospa_switch="T-GOSPA, switches",
    gospa="GOSPA",
    gospa_localisation="GOSPA, localisation",
    gospa_missed="GOSPA, missed",
    gospa_false="GOSPA, false",
)


@dataclass(frozen=True)
class Sums:
    """Total and number of the terms of each measure, by run; their ratio is the measure."""

    values: dict[str, Array]
    """Total and number ``(2, runs)``, by measure."""
    metric: Metric | None = None
    """Metric whose best value the tuning seeks; None if it seeks that of a built-in measure."""
    blocks: tuple[MetricSums, ...] = ()
    """Sums of ``metric`` for consecutive blocks of runs, each by accumulator; empty without ``metric``."""

    @classmethod
    def joined(cls, parts: Sequence[Sums]) -> Sums:
        """Join the sums of consecutive blocks of runs."""
        values = {name: np.concatenate([part.values[name] for part in parts], axis=1) for name in parts[0].values}
        return cls(values, parts[0].metric, tuple(block for part in parts for block in part.blocks))

    @property
    def measures(self) -> dict[str, Metric]:
        """Measures by which start and tuned values can be compared, by name."""
        names = dict.fromkeys([*OF_ALL, *(name for name in self.values if name in TRACK_METRICS)])
        objective = {} if self.metric is None else {self.metric.name: self.metric}
        return {name: MEASURES[name] for name in names} | objective

    def has(self, name: str) -> bool:
        """Return whether a measure was summed."""
        return name in self.values or (self.metric is not None and name == self.metric.name)

    def interval(self, name: str, scene: Indices) -> Interval | None:
        """Return a measure with what each run or scene adds to it; None where no run has a value.

        ``scene`` is the number of the scene of each run, ``(runs,)``.
        """
        if self.metric is not None and name == self.metric.name:
            metrics = metrics_of_trial(self.metric)
            return evaluate(merge_sums(self.blocks, metrics), scene, metrics).intervals.get(name)
        if name not in self.values:
            return None
        interval = MEASURES[name].of_runs(*self.values[name])
        return None if interval is None else clustered(interval, scene)

    def value(self, name: str) -> float:
        """Return the value of a measure over all runs; NaN where no run has a value."""
        runs = next(iter(self.values.values())).shape[1]
        interval = self.interval(name, np.zeros(runs, dtype=np.intp))
        return np.nan if interval is None else interval.value

    def lacking(self, start: Sums, name: str) -> str | None:
        """Return the reason why the sums cannot be compared with the start's; None where they can.

        A missing estimate adds an error to an RMSE. It adds nothing to a likelihood or NEES: their terms are counted.

        Args:
            start: sums of the start values; with known identities only innovations that the start gives were summed.
            name: measure by which the two are to be compared.
        """
        if name not in self.values or name not in start.values:
            return None
        number, start_number = self.values[name][1], start.values[name][1]
        word = "innovations" if name == "log_likelihood" else "estimates"
        fewer = name == "nees" and number.sum() < LEAST_COVERAGE * start_number.sum()
        if fewer or (name == "log_likelihood" and (number < start_number).any()):
            return f"it gives {number.sum():.0f} of the {start_number.sum():.0f} {word} that the start gives"
        return None if np.isfinite(self.values[name][0]).all() else f"its {word} are not finite"


def metrics_of_trial(metric: Metric) -> tuple[Metric, ...]:
    """Return the metrics that a block must compute for one metric; a metric of estimates needs coverage as well."""
    return (Coverage(), metric) if "tracks" not in metric.needs else (metric,)

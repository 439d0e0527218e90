"""What is kept of a trial: of each run the sums of its errors and of the likelihood of its innovations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics import Metric, evaluate, merge_sums
from trackbench.metrics.breakdown import DOF, band_name
from trackbench.metrics.built_in.basic import Coverage
from trackbench.metrics.conditions import AGES, BANDS, MANOEUVRES, SHAPE, Classes
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.intervals import Interval, clustered, ratio, root
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.verdicts import ABOVE, BELOW, HALVES, SMALLEST_SHARE

#: Of labelled objects: the unit of each measure.
UNITS = {"position_rmse": "m", "velocity_rmse": "m/s", "nees": "", "log_likelihood": ""}
#: Measures of tracks, of detections that nobody labelled.
OF_TRACKS = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false")


class _Words(dict[str, str]):
    def __missing__(self, measure: str) -> str:
        return measure.replace("_", " ")


#: Each measure as a sentence names it.
WORDS = _Words(
    position_rmse="position RMSE",
    velocity_rmse="velocity RMSE",
    nees="mean NEES",
    log_likelihood="log-likelihood of a measurement",
    gospa="GOSPA",
    gospa_localisation="GOSPA, localisation",
    gospa_missed="GOSPA, missed",
    gospa_false="GOSPA, false",
)
#: Components of the state whose NEES is taken.
NEES_DOF = 4


@dataclass(frozen=True)
class Sums:
    """Of each run and measure, the total of its terms and their number."""

    values: dict[str, Array]
    """By measure ``(2, runs)``."""
    metric: Metric | None = None
    """That of the objective, if it is none of the measures."""
    blocks: tuple[MetricSums, ...] = ()
    """Its sums of consecutive runs, by accumulator."""

    @classmethod
    def joined(cls, parts: Sequence[Sums]) -> Sums:
        """Those of consecutive runs as one."""
        values = {name: np.concatenate([part.values[name] for part in parts], axis=1) for name in parts[0].values}
        return cls(values, parts[0].metric, tuple(block for part in parts for block in part.blocks))

    def with_metric(self, metric: Metric, block: MetricSums) -> Sums:
        """With the sums of a metric of the same runs."""
        return replace(self, metric=metric, blocks=(block,))

    def has(self, name: str) -> bool:
        """Whether a measure was summed."""
        return name in self.values or (self.metric is not None and name == self.metric.name)

    @property
    def units(self) -> dict[str, str]:
        """By every measure that start and tuned may be compared by, its unit."""
        of_tracks = {name: TRACK_METRICS[name].unit for name in self.values if name in TRACK_METRICS.keys() - UNITS}
        own = {} if self.metric is None else {self.metric.name: self.metric.unit}
        return {name: "" if unit == "1" else unit for name, unit in {**UNITS, **of_tracks, **own}.items()}

    def interval(self, name: str, scene: Indices) -> Interval | None:
        """A measure with what each run, or scene, adds to it; None where no run tells it.

        Args:
            name: of the measure.
            scene: ``(runs,)`` number of the scene of each run.
        """
        if self.metric is not None and name == self.metric.name:
            return self._of_metric(self.metric, scene)
        if name not in self.values:
            return None
        total, count = self.values[name]
        if not count.any():
            return None
        if name in TRACK_METRICS:
            estimate = TRACK_METRICS[name].of_runs(total, count)
            return None if estimate is None else clustered(estimate, scene)
        if name == "log_likelihood":
            return clustered(ratio(total, count), scene)
        mean = ratio(total, count, at_least=0.0)
        return clustered(root(mean) if name.endswith("_rmse") else mean, scene)

    def _of_metric(self, metric: Metric, scene: Indices) -> Interval | None:
        metrics = metrics_of_trial(metric)
        return evaluate(merge_sums(self.blocks, metrics), scene, metrics).intervals.get(metric.name)

    def value(self, name: str) -> float:
        """A measure over all runs; NaN where no run tells it."""
        runs = next(iter(self.values.values())).shape[1]
        interval = self.interval(name, np.zeros(runs, dtype=np.intp))
        return np.nan if interval is None else interval.value

    def lacking(self, start: Sums, measures: Sequence[str] = ("position_rmse", "log_likelihood")) -> str | None:
        """What there is less of than with the start's values, or is not finite, so that the two cannot be compared.

        Args:
            start: of the tracker as it is; of labelled objects nothing else was summed than what it gives.
            measures: by which the two are to be compared.
        """
        for name in measures:
            if name not in self.values or name not in start.values:
                continue
            own, other = self.values[name][1], start.values[name][1]
            word = "innovations" if name == "log_likelihood" else "estimates"
            if (own < other).any():
                common = np.minimum(own, other).sum()
                return f"it gives {common:.0f} of the {other.sum():.0f} {word} that the start gives"
            if not np.isfinite(self.values[name][0]).all():
                return f"its {word} are not finite"
        return None


def metrics_of_trial(metric: Metric) -> tuple[Metric, ...]:
    """What a block computes for a metric: that, and of estimates the sums that any block has."""
    return (Coverage(), metric) if metric.scores == "estimates" else (metric,)


#: Each manoeuvre, each range band and the first second.
CONDITIONS = (*MANOEUVRES, *(band_name(band) for band in range(BANDS)), AGES[0])
#: How far the logarithm of a mean over its degrees of freedom may be off, below and above: somewhat less than what the
#: verdict tolerates, so that it holds on other scenes too.
LOW, HIGH = 0.7 * math.log(1.0 - BELOW), 0.7 * math.log(1.0 + ABOVE)


def condition_members(classes: Classes) -> Array:
    """``(conditions, instants, objects, runs or 1)`` 1 where an object is under a condition.

    Args:
        classes: ``(instants, objects, runs or 1)`` as ``metrics.conditions`` gives them.
    """
    manoeuvre, band, age, _ = np.unravel_index(classes, SHAPE)
    under = [
        *(manoeuvre == number for number in range(len(MANOEUVRES))),
        *(band == number for number in range(BANDS)),
        age == 0,
    ]
    return np.stack(under).astype(float)


def nees_by_condition(sums: Sums, start: Sums) -> Iterator[tuple[str, float]]:
    """By condition of which the start gives enough estimates, the logarithm of the mean NEES over its degrees of
    freedom: of every trial the same conditions."""
    everything = start.values["nees"][1].sum()
    for name in (*CONDITIONS, *HALVES):
        if start.values[name][1].sum() >= SMALLEST_SHARE * everything:
            dof = DOF["nees_position"] if name in HALVES else DOF["nees"]
            yield name, float(np.log(sums.value(name) / dof))


def condition_excess(value: float) -> float:
    """How far such a logarithm is beyond what is allowed."""
    return max(0.0, value - HIGH, LOW - value)

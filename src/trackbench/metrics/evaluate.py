"""Metric values and intervals of one tracker, computed from its sums."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from trackbench.base.answers import require, require_array
from trackbench.base.plugins import one_line
from trackbench.base.types import EXACT, Array, Indices, RecordedNoise
from trackbench.metrics.breakdown import joined_classes
from trackbench.metrics.built_in import BUILT_IN
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.intervals import Interval, clustered
from trackbench.metrics.protocol import Accumulator, Metric, Outcome, run_column
from trackbench.metrics.sums import BlockScores, added
from trackbench.results import Health, MetricValue

log = logging.getLogger(__name__)

#: Sums over a tracker's estimates or tracks, by name of the accumulator.
MetricSums = dict[str, Any]


@dataclass
class Evaluation:
    """Metric values and intervals of one tracker, with the sums that they are computed from."""

    sums: MetricSums
    """Sums over the tracker's estimates or tracks in all runs, by name of the accumulator."""
    values: dict[str, MetricValue] = field(default_factory=dict)
    """Metric values with interval, unit and verdict, by dotted path."""
    intervals: dict[str, Interval] = field(default_factory=dict)
    """Intervals of the metrics that are means, by dotted path."""
    run_columns: dict[str, Array] = field(default_factory=dict)
    """Columns ``(runs,)`` of the table of runs, by name, for metrics that have sums of their own."""
    broken: dict[str, str] = field(default_factory=dict)
    """Message of the error that a user's metric raised in ``finish``, by name of the metric."""

    @property
    def scores(self) -> BlockScores:
        """Sums of squared errors, NEES and innovations, from which the built-in metrics of estimates are computed."""
        scores: BlockScores = self.sums[ESTIMATES.name]
        return scores


def evaluate(
    sums: MetricSums,
    scene: Indices,
    metrics: Sequence[Metric] = BUILT_IN,
    noise: RecordedNoise = EXACT,
    *,
    in_time: bool = False,
    few_scenes_decide: bool = False,
) -> Evaluation:
    """Compute the metrics of estimates or of tracks from the sums of all runs.

    Args:
        sums: merged sums, see :func:`merge_sums`.
        scene: ``(runs,)`` number of the scene of each run.
        metrics: metrics to compute.
        noise: noise of the truth, if it is recorded.
        in_time: whether the scenes are successive stretches of time.
        few_scenes_decide: whether rare scenes, one in a hundred, can decide which of two trackers is better.
    """
    evaluation = Evaluation(dict(sums))
    sensors: list[str] = []
    if ESTIMATES.name in sums:
        blocks: BlockScores = sums[ESTIMATES.name]
        sensors = list(blocks.nis)
        evaluation.sums[ESTIMATES.name] = independent_scores(blocks, scene)
    for metric in metrics:
        # Sums of the built-in metrics of estimates are by independent part already.
        by_part = metric.accumulator is ESTIMATES
        parts = evaluation.scores.per_part.shape[1] if by_part else len(scene)
        metric_sums = evaluation.sums[metric.accumulator.name]
        try:
            values = _checked(metric, metric_sums, sensors, parts)
        except Exception as error:
            if is_built_in(metric):
                raise
            evaluation.broken[metric.name] = cause = one_line(error)
            values = {metric.name: (MetricValue(unit=metric.unit, reason=cause), None)}
        charged = metric.without_charged(metric_sums) if by_part else None
        for path, (value, interval) in values.items():
            if metric.shared is None or run_column(path) in metric.columns:
                evaluation.run_columns |= metric.in_runs(path, metric_sums, interval, len(scene))
            if interval is not None:
                if not by_part:
                    interval = clustered(interval, scene, in_time=in_time)
                    value = interval.as_value(metric.unit)
                elif blocks.stretches is not None:
                    interval = interval._replace(of_stretches=True)
                if noise != EXACT and (axes := metric.reference_axes(path, metric_sums)):
                    sigma = noise.position_m if metric.unit == "m" else noise.velocity_mps
                    value = widen_for_reference(value, axes * sigma**2)
                evaluation.intervals[path] = interval._replace(few_decide=few_scenes_decide)
            if charged is not None:
                value = value.model_copy(update={"charged_share": charged[0], "without_charged": charged[1]})
            evaluation.values[path] = value
    return evaluation


def widen_for_reference(error: MetricValue, variance: float) -> MetricValue:
    """Widen the interval of an RMSE for errors of the reference, which have the mean square ``variance``.

    Reference errors are independent of the tracker's: ``variance`` is added to the square of the upper end and
    subtracted from the square of the lower end. All trackers share the reference errors, so no difference is widened.
    """
    if error.ci95 is None:
        return error
    low, high = error.ci95
    ends = math.sqrt(max(low**2 - variance, 0.0)), math.sqrt(high**2 + variance)
    return error.model_copy(update={"ci95": ends})


def independent_scores(merged: BlockScores, scene: Indices) -> BlockScores:
    """Return the sums within independent parts: scenes, runs of one scene, or stretches of a single run.

    Runs of one scene share its traffic, so the scenes are the independent parts where there are several. A single run,
    and each of few logs, is cut into stretches of time (batch means: Schmeiser 1982, "Batch size effects in the
    analysis of simulation output").

    Args:
        merged: sums over all runs.
        scene: ``(runs,)`` number of the scene of each run.
    """
    if scene[-1] == 0 or merged.stretches is not None:
        return replace(merged, classes=[(len(scene), joined_classes(merged.classes, None))])
    return replace(
        merged,
        per_part=added(merged.per_part, scene),
        charged=added(merged.charged, scene),
        nis={name: replace(item, per_part=added(item.per_part, scene)) for name, item in merged.nis.items()},
        classes=[(len(scene), joined_classes(merged.classes, scene))],
        scenes=True,
    )


def no_metrics(reason: str, metrics: Iterable[Metric] = BUILT_IN) -> dict[str, MetricValue]:
    """Return, by path, a missing value of every metric with ``reason``, for a tracker that could not be scored."""
    return {metric.name: metric.no_value(reason) for metric in metrics if not metric.per_sensor}


def health(scores: BlockScores) -> Health:
    """Count diverged runs, repaired covariances and missing estimates, faults that did not end the run."""
    return Health(
        diverged_runs=int(scores.diverged.sum()),
        repaired_covariances=int(scores.repaired.sum()),
        repaired_runs=int((scores.repaired > 0).sum()),
        missing_estimates=int(scores.due.sum() - scores.given),
    )


def accumulators(metrics: Sequence[Metric]) -> dict[str, Accumulator]:
    return {metric.accumulator.name: metric.accumulator for metric in metrics}


def merge_sums(blocks: Sequence[MetricSums], metrics: Sequence[Metric] = BUILT_IN) -> MetricSums:
    """Merge the sums of consecutive blocks of runs, for each accumulator of the metrics."""
    return {name: item.merge([block[name] for block in blocks]) for name, item in accumulators(metrics).items()}


def is_built_in(plugin: Accumulator | Metric) -> bool:
    """Return whether a metric, or an accumulator that sums for metrics, is built in and not of a plug-in."""
    return type(plugin).__module__.startswith("trackbench.")


def _checked(
    metric: Metric, sums: Any, sensors: Sequence[str], parts: int
) -> dict[str, tuple[MetricValue, Interval | None]]:
    outcome = metric.finish(sums)
    by_name = outcome if isinstance(outcome, Mapping) else {"": outcome}
    values = {
        f"{metric.name}.{name}" if name else metric.name: _value(value, metric, parts)
        for name, value in by_name.items()
    }
    paths = {f"{metric.name}.{sensor}" for sensor in sensors} if metric.per_sensor else {metric.name}
    names = " and ".join(sorted(paths)) or "none"
    require(values.keys() == paths, "the names of the values that finish returns", names, [*values])
    for value, _ in values.values():
        MetricValue.model_validate(dict(value))
    return values


def _value(outcome: Outcome, metric: Metric, parts: int) -> tuple[MetricValue, Interval | None]:
    if isinstance(outcome, MetricValue):
        return outcome, None
    interval = outcome if isinstance(outcome, Interval) else None
    number = outcome.value if isinstance(outcome, Interval) else outcome
    if number is None or not math.isfinite(number):
        return metric.no_value("it is not a number"), None
    if interval is None:
        return MetricValue(value=float(number), unit=metric.unit), None
    require_array("the influence of an interval", interval.influence, [(parts,)])
    return interval.as_value(metric.unit), interval


def log_broken(broken: Iterable[Mapping[str, str]]) -> None:
    """Log each metric that raised an error, once per metric; ``broken`` has each tracker's errors by metric name."""
    for metric, cause in {name: cause for each in broken for name, cause in each.items()}.items():
        log.warning("metric %s has no value: %s", metric, cause)

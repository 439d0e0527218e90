"""The metrics of driver assistance functions: delays, missed and false warnings, errors of their quantities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from types import new_class
from typing import Any, ClassVar

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.count_intervals import Counted
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Direction, Field, Metric, Outcome, run_column
from trackbench.subjects.functions.protocol import FUNCTIONS, Function
from trackbench.subjects.functions.sums import FunctionScores, FunctionSums

NO_EVENT = "the function is never active on the truth: no event"


class FunctionMetric(Metric):
    """Metric of one driver assistance function; :func:`function_metrics` makes a class for each function."""

    needs: ClassVar[Set[str]] = frozenset({"truth"})
    better: ClassVar[Direction | None] = "smaller"
    at_least: ClassVar[float] = 0.0
    stem: ClassVar[str]
    """First part of the metric's name; the name of the function follows."""
    label: ClassVar[str]
    """Name of the driver assistance function: its key under ``functions:`` in the scenario."""
    function: ClassVar[Function]
    total: ClassVar[str]
    """Name of the row of the sums with the metric's total; ``count`` names the row with the number of terms."""
    count: ClassVar[str]
    missing: ClassVar[str] = NO_EVENT
    """Reason to state if the metric has no value, because there are no terms to average."""
    squared: ClassVar[bool] = False
    """Whether the terms are squares, so that the value is a root mean square."""
    counted: ClassVar[Counted | None] = None
    """Kind of a metric that counts events, ``share`` or ``rate``; None for a mean."""

    def __reduce__(self) -> tuple[Any, ...]:
        # The class is made at run time, so that pickle cannot find it by name.
        return _metric_of_function, (type(self).__bases__[0], self.label, self.function)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of two columns: the metric's value in each run, and the number of terms in the value."""
        return run_column(self.name), f"{self.name}_count"

    def in_runs(self, path: str, sums: FunctionScores, interval: Interval | None, runs: int) -> dict[str, Array]:
        values, count = np.full(runs, np.nan), np.zeros(runs)
        if interval is not None:
            count = sums.of(self.count)
            np.divide(sums.of(self.total), count, out=values, where=count > 0)
        return dict(zip(self.columns, (np.sqrt(values) if self.squared else values, count), strict=True))

    def of_runs(self, *columns: Array) -> Interval | None:
        value, count = columns
        total = np.where(count > 0, value**2 if self.squared else value, 0.0) * count
        return self._over_runs(total, count)

    def finish(self, sums: FunctionScores) -> Outcome:
        return self._over_runs(sums.of(self.total), sums.of(self.count)) or self.no_value(self.missing)

    def _over_runs(self, total: Array, count: Array) -> Interval | None:
        if not count.sum() > 0:
            return None
        value = ratio(total, count, at_least=self.at_least, at_most=self.at_most)
        value = root(value) if self.squared else value
        return value._replace(counted=self.counted, sparse=self.counted is None)


class WarnDelay(FunctionMetric):
    """Mean signed delay of warnings. Neither sign is better; trackers are compared by ``warn_error``."""

    stem, total, count, unit = "warn_delay", "delay", "events", "s"
    meaning = "time from an event on the truth to that on the tracks, mean over events"
    better, at_least = None, -np.inf
    fields = (
        Field("p05", "time that 5 % of the delays are below", unit="s"),
        Field("p50", "time that half of the delays are below", unit="s"),
        Field("p95", "time that 95 % of the delays are below", unit="s"),
        Field("early", "mean of the delays below 0", unit="s"),
        Field("late", "mean of the delays above 0", unit="s"),
        Field("missing", "share of events without an answer, whose delay is to the impact, or to 0.5 s after the end"),
    )

    def finish(self, sums: FunctionScores) -> Outcome:
        value = super().finish(sums)
        if not isinstance(value, Interval):
            return value
        delay = sums.delay
        low, middle, high = np.quantile(delay, [0.05, 0.5, 0.95]).tolist()
        details = {"p05": low, "p50": middle, "p95": high, "missing": float(sums.missing.mean())}
        apart = {"early": delay[delay < 0], "late": delay[delay > 0]}
        details |= {name: float(delays.mean()) for name, delays in apart.items() if len(delays)}
        return value._replace(details=tuple(details.items()))


class WarnError(FunctionMetric):
    stem, total, count, unit, squared = "warn_error", "squared_delay", "events", "s", True
    meaning = "root mean square delay of the events on the tracks"


class MissedWarnings(FunctionMetric):
    stem, total, count, unit, at_most = "missed_warnings", "missing", "events", "1", 1.0
    counted = "share"
    meaning = "share of the events on the truth without one on the tracks"


class FalseWarnings(FunctionMetric):
    stem, total, count, unit = "false_warnings", "false", "hours", "1/h"
    meaning = "events on the tracks without one on the truth, or that begin too early for it, per hour of the drive"
    missing = "the drive has no length"
    counted = "rate"


class QuantityError(FunctionMetric):
    """Error of the function's quantity, such as a time to collision, in the first ``TOLERANCE`` s of each event.

    Only instants count at which the quantity has a value on the truth and on the tracks.
    """

    total, count, squared = "squared_error", "errors", True
    meaning = "root mean square error of the {}, in the first 0.5 s of each event"
    missing = "there is no event in which it has a value on the truth and on the tracks"


class LeadErrors(FunctionMetric):
    stem, total, count, unit, at_most = "lead_errors", "wrong_lead", "leads", "1", 1.0
    meaning = "share of the instants with a lead at which the tracks show another lead than the truth"
    missing = "there is never a lead"


class BrakeError(FunctionMetric):
    stem, total, count, unit, squared = "brake_error", "squared_braking", "braking", "m/s^2", True
    meaning = "root mean square difference of the deceleration commanded on the tracks and on the truth"
    missing = "it brakes neither on the truth nor on the tracks"


EVENT_METRICS: tuple[type[FunctionMetric], ...] = (WarnDelay, WarnError, MissedWarnings, FalseWarnings)


def function_metrics(functions: Mapping[str, Function]) -> tuple[FunctionMetric, ...]:
    """Return the metrics of each driver assistance function, such as the delay of its warnings."""
    return tuple(
        _metric_of_function(kind, label, function) for label, function in functions.items() for kind in _kinds(function)
    )


def published_metrics() -> list[FunctionMetric]:
    """Return the metrics of all published driver assistance functions, each once, with ``<function>`` as the name."""
    metrics = [
        metric
        for function in FUNCTIONS.loaded().values()
        for metric in function_metrics({"<function>": function.model_construct()})
    ]
    return list({metric.name: metric for metric in metrics}.values())


def functions_among(metrics: Iterable[Metric]) -> dict[str, Function]:
    """Return the driver assistance functions to which some metrics belong, by name."""
    return {metric.label: metric.function for metric in metrics if isinstance(metric, FunctionMetric)}


def _kinds(function: Function) -> list[type[FunctionMetric]]:
    more = [LeadErrors] if function.chooses_lead else []
    return [*EVENT_METRICS, QuantityError, *more, *([BrakeError] if function.brakes else [])]


def _metric_of_function(kind: type[FunctionMetric], label: str, function: Function) -> FunctionMetric:
    quantity = function.quantity
    members: dict[str, Any] = {"stem": f"{quantity.name}_error", "unit": quantity.unit} if kind is QuantityError else {}
    stem = members.get("stem") or kind.stem
    members |= {
        "name": f"{stem}.{label}",
        "meaning": kind.meaning.format(quantity.meaning),
        "label": label,
        "function": function,
        "shared": FunctionSums(label, function),
        "__module__": __name__,
    }
    metric: FunctionMetric = new_class(kind.__name__, (kind,), {}, lambda body: body.update(members))()
    return metric

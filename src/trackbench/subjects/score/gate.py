"""The gates of a score: limits on a metric, absolute or relative to the first file of tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.numbers import stated_number
from trackbench.compare.comparison import GateOutcome
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.report.junit import Case
from trackbench.results import Result

OPTION = "--gate"


class Gate(NamedTuple):
    """Limit on a metric that tracks have to keep: a value, or a percentage of the first file's value."""

    metric: str
    limit: float
    relative: bool
    """Whether the limit is a percentage of the value of the first file of tracks."""

    @classmethod
    def parse(cls, text: str) -> Gate:
        """Return the gate of a text such as ``gospa:0.8`` or ``gospa:2%``.

        Raises:
            InputError: the text is no gate.
        """
        metric, colon, number = text.rpartition(":")
        if not colon:
            raise InputError(f"write METRIC:VALUE or METRIC:PERCENT%, such as gospa:2%, not {text!r}", key=OPTION)
        if metric not in TRACK_METRICS:
            raise InputError(f"no metric {metric!r}; {nearest_choices(metric, TRACK_METRICS)}", key=OPTION)
        if TRACK_METRICS[metric].better is None:
            raise InputError(f"neither a larger nor a smaller {metric} is better", key=OPTION)
        relative = number.endswith("%")
        limit = stated_number(number.removesuffix("%"))
        if not math.isfinite(limit) or (relative and limit < 0):
            raise InputError(f"{number!r} is no number, or no percentage of 0 or more", key=OPTION)
        return cls(metric, limit, relative)

    def require_files(self, number: int) -> None:
        """Refuse a limit relative to the first file of tracks if there is no second file.

        Raises:
            InputError: the gate is relative and there is only one file.
        """
        if self.relative and number < 2:
            message = f"{self.limit:g} % of what? Name the file to compare with first, or a value: {self.metric}:VALUE"
            raise InputError(message, key=OPTION)

    @property
    def text(self) -> str:
        """Condition of the gate in words: "gospa at most 0.8"."""
        smaller = TRACK_METRICS[self.metric].better == "smaller"
        if self.relative:
            return f"{self.metric} not worse than that of the first file by more than {self.limit:g} %"
        return f"{self.metric} {'at most' if smaller else 'at least'} {self.limit:g}"


class JudgedGate(NamedTuple):
    """Outcome of a gate for the tracks of one file."""

    tracker: str
    metric: str
    limit: float | None
    """Limit in the unit of the metric; None for a relative limit if the first file of tracks has no value."""
    value: float | None
    unit: str
    ci95: tuple[float, float] | None
    passed: bool
    text: str
    found: str

    def case(self, scenario: str) -> Case:
        """Return the outcome as a test case; an error where a value is missing."""
        missing = self.value is None or self.limit is None
        outcome: GateOutcome = "passed" if self.passed else "error" if missing else "failed"
        return Case(f"{self.tracker}: {self.text}", f"{scenario}.{self.tracker}", outcome, self.found)


def judge_gates(gates: Sequence[Gate], result: Result) -> list[JudgedGate]:
    """Return the outcome of each gate for each file, of relative gates for each file but the first.

    Intervals play no role: equal files always have equal outcomes.
    """
    trackers = result.summary.trackers
    judgements = []
    for gate in gates:
        first = trackers[0].metrics[gate.metric].value
        for tracker in trackers[1:] if gate.relative else trackers:
            metric = tracker.metrics[gate.metric]
            sign = 1.0 if TRACK_METRICS[gate.metric].better == "smaller" else -1.0
            limit: float | None = gate.limit
            if gate.relative:
                limit = None if first is None else first + sign * abs(first) * gate.limit / 100
            passed, evidence = False, metric.reason or "the first file has no value"
            if metric.value is not None and limit is not None:
                passed = sign * (metric.value - limit) <= 0
                unit = "" if metric.unit == "1" else f" {metric.unit}"
                evidence = f"{metric.value:.4g}{unit}" + (f", the first {first:.4g}" if gate.relative else "")
            value = (metric.value, metric.unit, metric.ci95)
            judgements.append(JudgedGate(tracker.name, gate.metric, limit, *value, passed, gate.text, evidence))
    return judgements

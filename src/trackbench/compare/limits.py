"""Limits on regressions: whether a tracker got worse than in the baseline result by more than a stated percentage."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from trackbench.base.errors import InputError, counted
from trackbench.base.numbers import stated_number
from trackbench.compare.comparison import GateOutcome, GateResult, NotCompared, PairDifference
from trackbench.metrics import Metric

OPTION = "--fail-on-regression"


class Limit(NamedTuple):
    """Largest percentage by which a metric is allowed to be worse than in the baseline result."""

    metric: str
    percent: float

    @classmethod
    def parse(cls, text: str) -> Limit:
        """Parse a limit from the command line, such as ``position_rmse:5`` or ``position_rmse:5%``.

        Raises:
            InputError: the text does not state a limit.
        """
        metric, colon, number = text.rpartition(":")
        if not colon:
            raise InputError(f"write METRIC:PERCENT, such as position_rmse:5, not {text!r}", key=OPTION)
        percent = stated_number(number.removesuffix("%"))
        if not 0.0 <= percent < math.inf:
            raise InputError(f"{number!r} is no percentage of 0 or more, as in {metric}:5", key=OPTION)
        return cls(metric, percent)


def gate_results(
    limits: Sequence[Limit],
    metrics: Mapping[str, Metric],
    differences: Sequence[PairDifference],
    missing: Sequence[NotCompared],
) -> list[GateResult]:
    """Return the outcome of each limit for each tracker of each later set of results, in each scenario.

    A limit is a test of non-inferiority. A limit is kept (``passed``) where the whole 95 % interval of the difference
    is within the limit. A limit is broken (``failed``) where the value is worse by more than the limit, and the
    corrected p-value shows that the value is worse by more than the margin, which is at most the limit. Else the limit
    is ``undecided``, and does not pass. Values of the same recorded data without an interval are compared as they are.
    """
    results = []
    for limit in limits:
        for item in differences:
            if item.metric == limit.metric:
                outcome = _outcome(item, limit, metrics[limit.metric])
                results.append(_result(item, limit, outcome, _text(item, limit, outcome)))
        for gap in missing:
            if gap.metric == limit.metric:
                results.append(_result(gap, limit, "error" if gap.of_entrant else "undecided", gap.reason))
    return results


def _result(item: PairDifference | NotCompared, limit: Limit, outcome: GateOutcome, text: str) -> GateResult:
    return GateResult(
        scenario=item.scenario,
        entrant=item.entrant,
        metric=limit.metric,
        percent=limit.percent,
        outcome=outcome,
        text=text,
    )


def _outcome(item: PairDifference, limit: Limit, metric: Metric) -> GateOutcome:
    sign = 1.0 if metric.better == "smaller" else -1.0
    allowed = limit.percent / 100 * abs(item.reference)
    as_they_are = item.ci95 is None and item.repeatable
    worst = max(sign * end for end in item.ci95 or (item.difference,))
    if worst <= allowed and (item.ci95 or as_they_are or item.identical or item.verdict == "better"):
        return "passed"
    is_broken = sign * item.difference > allowed and (as_they_are or item.verdict == "worse")
    return "failed" if is_broken else "undecided"


def _text(item: PairDifference, limit: Limit, outcome: GateOutcome) -> str:
    allowed = f"{limit.percent:g} % allowed"
    if item.identical:
        return f"the same in every run; {allowed}"
    if item.ci95 is None and item.repeatable:
        allowed = f"compared by value, without an interval; {allowed}"
    if item.percent is None:
        return f"from 0 to {item.value:.4g} {item.unit}; {allowed}"
    reach = ""
    if item.percent_ci95 is not None:
        low, high = item.percent_ci95
        reach = f" (95 %: {low:+.1f} to {high:+.1f} %)"
    # Beside an undecided limit, a verdict on the margin would answer another question.
    word = f", {item.verdict}" if outcome != "undecided" and item.verdict in ("better", "worse") else ""
    return f"{item.percent:+.1f} %{reach}{word}; {allowed}"


def limits_in_words(outcomes: Sequence[GateOutcome]) -> str:
    """Return how many limits are kept or broken: "2 of 2 limits kept", "1 of 3 limits broken"."""
    broken, undecided = sum(item in ("failed", "error") for item in outcomes), outcomes.count("undecided")
    parts = [(broken, "broken"), (undecided, "not shown to be kept")]
    (number, word), *rest = [part for part in parts if part[0]] or [(len(outcomes), "kept")]
    return ", ".join([f"{number} of {counted(len(outcomes), 'limit')} {word}", *(f"{n} {what}" for n, what in rest)])


def exit_line(outcomes: Sequence[GateOutcome], status: int) -> str:
    """Return a line for the terminal: how many limits are kept, the exit status of the command, and its rule."""
    return f"{limits_in_words(outcomes)}: exit status {status} (0: all kept)"

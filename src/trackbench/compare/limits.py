"""Whether a later result is worse than the baseline by more than is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from trackbench.base.errors import InputError
from trackbench.base.numbers import stated_number
from trackbench.compare.comparison import GateOutcome, GateResult, NotCompared, PairDifference
from trackbench.metrics import Metric

OPTION = "--fail-on-regression"


class Limit(NamedTuple):
    """How much worse a metric may become."""

    metric: str
    percent: float

    @classmethod
    def parse(cls, text: str, key: str = OPTION) -> Limit:
        """``position_rmse:5`` or ``position_rmse:5%``.

        Raises:
            InputError: it is something else.
        """
        metric, colon, number = text.rpartition(":")
        if not colon:
            raise InputError(f"write METRIC:PERCENT, such as position_rmse:5, not {text!r}", key=key)
        percent = stated_number(number.removesuffix("%"))
        if not 0.0 <= percent < math.inf:
            raise InputError(f"{number!r} is no percentage of 0 or more, as in {metric}:5", key=key)
        return cls(metric, percent)


def require_directed(metric: Metric, key: str = OPTION) -> None:
    """Make sure that a metric can become worse.

    Raises:
        InputError: neither a larger nor a smaller one is better.
    """
    if metric.better is None:
        message = f"neither a larger nor a smaller {metric.path} is better; state expectations instead"
        raise InputError(message, key=key)


def gate_results(
    limits: Sequence[Limit],
    metrics: Mapping[str, Metric],
    differences: Sequence[PairDifference],
    missing: Sequence[NotCompared],
) -> list[GateResult]:
    """Each limit held against each tracker of each later set in each scenario.

    It fails where the value is worse by more than the limit, and shown to be worse by more than the margin, which is
    not more than the limit, after the correction for their number.
    So chance alone does not fail a build, and a regression that the runs show does not pass because the interval still
    touches the limit. Where it does not fail, but the interval reaches beyond the limit, it is undecided.
    """
    results = []
    for limit in limits:
        for item in differences:
            if item.metric == limit.metric:
                outcome, text = _outcome(item, limit, metrics[limit.metric]), _text(item, limit)
                results.append(_result(item, limit, outcome, text))
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
    if item.percent is None:
        # Nothing is a percentage of zero: any worsening that is shown is more.
        return "failed" if item.verdict == "worse" else "passed"
    sign = 1.0 if metric.better == "smaller" else -1.0
    if item.verdict == "worse" and sign * item.percent > limit.percent:
        return "failed"
    worst = max(sign * end for end in item.percent_ci95 or (item.percent,))
    return "undecided" if worst > limit.percent else "passed"


def _text(item: PairDifference, limit: Limit) -> str:
    allowed = f"{limit.percent:g} % allowed"
    if item.identical:
        return f"the same in every run; {allowed}"
    if item.percent is None:
        return f"from 0 to {item.value:.4g} {item.unit}; {allowed}"
    reach = ""
    if item.percent_ci95 is not None:
        low, high = item.percent_ci95
        reach = f" (95 %: {low:+.1f} to {high:+.1f} %)"
    return f"{item.percent:+.1f} %{reach}, {item.verdict}; {allowed}"

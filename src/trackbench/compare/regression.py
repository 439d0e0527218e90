"""Whether a later run is worse than the first by more than is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from trackbench.compare.differences import WORSE, Difference, Entrant, Missing, Outcome
from trackbench.compare.stored import StoredRun
from trackbench.errors import InputError, nearest
from trackbench.metrics.stored import ROOT_MEAN_SQUARES as COMPARED

PASSED, FAILED, UNDECIDED, ERROR = "passed", "failed", "undecided", "error"
OPTION = "--fail-on-regression"


@dataclass(frozen=True)
class Limit:
    """How much worse a metric may become."""

    metric: str
    percent: float


@dataclass(frozen=True)
class Judgement:
    """A limit held against one tracker of a later run."""

    entrant: Entrant
    limit: Limit
    outcome: str
    """``passed``, ``failed``, ``undecided`` (more than the limit is not shown and not excluded), ``error``."""
    text: str
    """What was found, in one line."""


def parse(text: str) -> Limit:
    """``position_rmse:5`` or ``position_rmse:5%``.

    Raises:
        InputError: it is something else.
    """
    metric, colon, number = text.rpartition(":")
    if not colon:
        raise InputError(f"write METRIC:PERCENT, such as position_rmse:5, not {text!r}", key=OPTION)
    if metric not in COMPARED:
        raise InputError(f"{metric!r} is not compared run by run; {nearest(metric, COMPARED)}", key=OPTION)
    try:
        percent = float(number.removesuffix("%"))
    except ValueError:
        percent = math.nan
    if not 0.0 <= percent < math.inf:
        raise InputError(f"{number!r} is no percentage of 0 or more, as in {metric}:5", key=OPTION)
    return Limit(metric, percent)


def require_judgeable(runs: Sequence[StoredRun], trackers: Sequence[str] | None) -> None:
    """Make sure that no regression could pass unseen.

    Raises:
        InputError: there is no later run, a run without an interval, or a tracker that a later run lacks.
    """
    if len(runs) < 2:
        raise InputError("needs two runs: the baseline, and a later one", key=OPTION)
    for run in runs:
        if run.summary.runs == 1:
            message = (
                "a single run gives no interval, so no regression can be shown; state expectations with below: instead"
            )
            raise InputError(message, file=run.label, key=OPTION)
    baseline = [name for name in runs[0].trackers if trackers is None or name in trackers]
    for later in runs[1:]:
        names = [name for name in later.trackers if trackers is None or name in trackers]
        lost = [name for name in baseline if name not in names]
        if lost and not len(baseline) == len(names) == 1:
            message = f"no tracker {lost[0]!r}, which the baseline has; name those to compare with --trackers"
            raise InputError(message, file=later.label, key=OPTION)


def judge(outcome: Outcome, limits: Sequence[Limit]) -> list[Judgement]:
    """Each limit held against each tracker of each later run.

    It fails where the estimate is worse by more than the limit and the difference is real, after the correction for
    their number. So chance alone does not fail a build, and a regression that the runs show does not pass because the
    interval still touches the limit. Where it does not fail, but the interval reaches beyond the limit, it is
    undecided.
    """
    return [judgement for limit in limits for judgement in _judge(outcome, limit)]


def _judge(outcome: Outcome, limit: Limit) -> Iterator[Judgement]:
    for item in outcome.differences:
        if item.metric == limit.metric:
            yield Judgement(item.entrant, limit, _result(item, limit), _text(item, limit))
    for missing in outcome.missing:
        if missing.metric == limit.metric:
            yield _without(missing, limit)


def _result(item: Difference, limit: Limit) -> str:
    estimate = item.percent
    if estimate is None:
        # Nothing is a percentage of an error of zero: any real error is more.
        return FAILED if item.verdict == WORSE else PASSED
    if item.verdict == WORSE and estimate > limit.percent:
        return FAILED
    worst = estimate if item.ci95 is None else 100.0 * item.ci95[1] / item.reference
    return UNDECIDED if worst > limit.percent else PASSED


def _text(item: Difference, limit: Limit) -> str:
    allowed = f"{limit.percent:g} % allowed"
    if item.identical:
        return f"the same in every run; {allowed}"
    if item.percent is None:
        return f"from 0 to {item.value:.4g} {item.unit}; {allowed}"
    reach = ""
    if item.ci95 is not None:
        low, high = (100.0 * end / item.reference for end in item.ci95)
        reach = f" (95 %: {low:+.1f} to {high:+.1f} %)"
    return f"{item.percent:+.1f} %{reach}, {item.verdict}; {allowed}"


def _without(missing: Missing, limit: Limit) -> Judgement:
    return Judgement(missing.entrant, limit, ERROR if missing.of_entrant else UNDECIDED, missing.reason)

"""Whether the last result is worse than those before it by more than is allowed."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.base.errors import InputError
from trackbench.compare.comparison import GateOutcome, GateResult
from trackbench.compare.differences import Match, differences
from trackbench.compare.limits import Limit, held, require_directed
from trackbench.results.metric_value import ResultModel
from trackbench.subjects.history.changes import Ways
from trackbench.subjects.history.found import PastResult

OPTION = "--gate"
#: The worst outcome first.
_ORDER: tuple[GateOutcome, ...] = ("error", "failed", "undecided", "passed")


class HistoryGate(ResultModel):
    """A limit held against one tracker of the last result."""

    tracker: str
    metric: str
    percent: float
    outcome: GateOutcome
    against: int | None
    """Of the window, the result that it does worst against; None where there is none."""
    text: str


def gates(
    entries: Sequence[PastResult], trackers: Sequence[str], limits: Sequence[Limit], window: int
) -> list[HistoryGate]:
    """Each limit against each tracker: it fails where the last result is worse by more than the limit than any result
    of the window, and shown to be worse, all differences corrected together.

    Raises:
        InputError: neither direction of a metric is better, or the last result has no interval of it.
    """
    last, before = entries[-1], range(max(0, len(entries) - 1 - window), len(entries) - 1)
    metrics = {limit.metric: last.metrics[limit.metric] for limit in limits}
    if not limits:
        return []
    for metric in metrics.values():
        require_directed(metric, OPTION)
        if why := last.without_interval(metric):
            raise InputError(f"no regression can be shown: {why}", file=last.label, key=OPTION)
    ways = Ways(entries, [*metrics.values()])
    there = [name for name in trackers if name in last.result]
    matches, refused = [], []
    for place in before:
        how, own = ways(place, len(entries) - 1), entries[place]
        if isinstance(how, str):
            refused.append(f"result {place + 1}: {how}")
            continue
        pairs = tuple((name, name) for name in there if name in own.result)
        matches.append(Match(last.result.name, last, own, place, how, pairs))
    allowed = {limit.metric: limit.percent for limit in limits}
    differing, missing = differences(matches, [*metrics.values()], over_scenarios=True, limits=allowed)
    outcomes = held(limits, metrics, differing, missing)
    lost = [name for name in trackers if before and name not in last.result and name in entries[-2].result]
    return [
        *(_worst(limit, name, outcomes, refused) for limit in limits for name in there),
        *(
            _gate(limit, name, "error", before[-1] + 1, "is not in the last result")
            for limit in limits
            for name in lost
        ),
    ]


def _worst(limit: Limit, tracker: str, outcomes: Sequence[GateResult], refused: Sequence[str]) -> HistoryGate:
    """What decides on a tracker: the worst outcome, of equal ones that of the latest result."""
    own = [item for item in outcomes if (item.metric, item.entrant.tracker) == (limit.metric, tracker)]
    if not own:
        why = f"no result of the window can be compared: {refused[-1]}" if refused else "there is no result before it"
        return _gate(limit, tracker, "undecided", None, why)
    item = min(own, key=lambda item: (_ORDER.index(item.outcome), -item.entrant.set))
    return _gate(limit, tracker, item.outcome, item.entrant.set + 1, item.text)


def _gate(limit: Limit, tracker: str, outcome: GateOutcome, against: int | None, text: str) -> HistoryGate:
    return HistoryGate(
        tracker=tracker, metric=limit.metric, percent=limit.percent, outcome=outcome, against=against, text=text
    )

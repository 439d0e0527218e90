"""Where a metric is shown to have changed, what changed with it, and whether that is more than is allowed.

The results of a tracker are in stretches. Each result is held against the first of its stretch with the same noise,
else against all those before it in the stretch together. A new stretch begins where one is shown to differ, or cannot
be compared. All these differences are corrected together (Holm).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from trackbench.base.errors import InputError
from trackbench.compare.comparability import Comparability, comparability, require_same_metric
from trackbench.compare.comparison import GateOutcome, GateResult, JudgedLimit, PairDifference
from trackbench.compare.differences import Match, judged_differences
from trackbench.compare.limits import Limit, gate_results, require_directed
from trackbench.metrics import Metric
from trackbench.metrics.differences import EQUIVALENT, UNDECIDED
from trackbench.subjects.history.past_results import PastResult, PooledResults

#: What a tracker's result is compared with, and how; or why not.
How = Comparability | str


@dataclass(frozen=True)
class ShownChange:
    """A metric of a tracker that is shown to differ from its stretch, by more than the margin."""

    since: int
    """Place of the first of the stretch."""
    difference: PairDifference


@dataclass
class MarkedStretches:
    """The stretches of every tracker of a history."""

    changes: list[ShownChange] = field(default_factory=list)
    breaks: dict[tuple[str, int], tuple[int, str]] = field(default_factory=dict)
    """By tracker and place of the result: that of the first of the stretch before, and why the two cannot be
    compared."""
    looks: int = 0
    """How many differences were looked at."""


def stretches_of(entries: Sequence[PastResult], trackers: Sequence[str], metrics: Sequence[Metric]) -> MarkedStretches:
    """The stretches of some trackers by some metrics.

    Args:
        entries: the earliest first.
        trackers: their names.
        metrics: by which.
    """
    marked, ways = MarkedStretches(), Ways(entries, metrics)
    starts: set[tuple[str, int]] = set()
    while True:
        looked = [item for tracker in trackers for item in _matches(entries, tracker, starts, ways, marked)]
        since = {(match.pairs[0][0], match.number): begin for begin, match in looked}
        differing, _ = judged_differences([match for _, match in looked], metrics, over_scenarios=True)
        marked.looks = max(marked.looks, len(differing))
        shown = [item for item in differing if item.verdict not in (EQUIVALENT, UNDECIDED)]
        shown = [item for item in shown if _key(item) not in starts]
        first: dict[str, int] = {}
        for tracker, place in map(_key, shown):
            first[tracker] = min(first.get(tracker, place), place)
        marked.changes += [ShownChange(since[_key(item)], item) for item in shown if _key(item) in first.items()]
        if not first:
            marked.changes.sort(key=lambda change: change.difference.entrant.set)
            return marked
        starts |= {*first.items()}


def _key(item: PairDifference) -> tuple[str, int]:
    """Its tracker, and the place of its result."""
    return item.entrant.tracker, item.entrant.set


class Ways:
    """How any two results of a history are compared, each pair looked at once."""

    def __init__(self, entries: Sequence[PastResult], metrics: Sequence[Metric]) -> None:
        self._entries, self._metrics = entries, metrics
        self._seen: dict[tuple[int, int], How] = {}

    def __call__(self, earlier: int, later: int) -> How:
        """Of two places."""
        if (earlier, later) not in self._seen:
            self._seen[earlier, later] = self._look(self._entries[earlier], self._entries[later])
        return self._seen[earlier, later]

    def _look(self, earlier: PastResult, later: PastResult) -> How:
        try:
            for metric in self._metrics:
                for entry in (earlier, later):
                    if metric.path not in entry.metrics:
                        return f"it has no {metric.path}" if entry is later else f"{earlier.label} has no {metric.path}"
                require_same_metric(earlier, later, metric.path)
            return comparability(earlier, later)
        except InputError as error:
            return error.message


def _matches(
    entries: Sequence[PastResult], tracker: str, starts: set[tuple[str, int]], ways: Ways, marked: MarkedStretches
) -> Iterator[tuple[int, Match]]:
    """Each result of a tracker with what it is held against, and the place of the first of its stretch; a result that
    begins a new stretch is the last of the one before too."""
    members: list[int] = []
    for place, entry in enumerate(entries):
        if tracker not in entry.trackers or entry.failure(tracker):
            continue
        if members:
            begin = members[0]
            same = next((number for number in members if entries[number].fingerprints & entry.fingerprints), begin)
            how = ways(same, place)
            if isinstance(how, str):
                marked.breaks[tracker, place] = begin, how
                members = [place]
                continue
            pooled = how.shared is None and len(members) > 1
            against = PooledResults.of([entries[number] for number in members]) if pooled else entries[same]
            yield begin, Match(entry.result.name, entry, against, place, how, ((tracker, tracker),))
        if (tracker, place) in starts:
            members = []
        members.append(place)


def causes(entries: Sequence[PastResult], tracker: str, since: int, place: int) -> list[str]:
    """What changed with a result of a tracker, after the first of its stretch; the latest first."""
    texts = []
    for number in range(place, since, -1):
        where = "" if number == place else f" (at result {number + 1})"
        texts += [f"{text}{where}" for text in _steps(entries[number - 1], entries[number], tracker)]
    return texts


def _steps(before: PastResult, after: PastResult, tracker: str) -> Iterator[str]:
    ours, theirs = before.result.summary, after.result.summary
    for name, version in _different(ours.versions, theirs.versions):
        yield f"{name} {version}"
    yield from (f"{ours.engine_in_words} to {theirs.engine_in_words}" for _ in [0] if ours.engine != theirs.engine)
    stated = [entry.result[tracker].describe if tracker in entry.result else None for entry in (before, after)]
    if None not in stated and stated[0] != stated[1]:
        yield f"{tracker}: {stated[0]} to {stated[1]}"
    elif scenario_sha256(before) != scenario_sha256(after):
        yield "the scenario"
    a, b = ours.provenance, theirs.provenance
    if a is None or b is None:
        return
    if a.code.get(tracker) != b.code.get(tracker):
        yield f"the code of {tracker}"
    if (a.commit, a.changed) != (b.commit, b.changed):
        yield f"commit {a.commit_in_words} to {b.commit_in_words}"


def _different(ours: Mapping[str, str], theirs: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for name in {**ours, **theirs}:
        if ours.get(name) != theirs.get(name):
            yield name, f"{ours.get(name, 'none')} to {theirs.get(name, 'none')}"


def scenario_sha256(entry: PastResult) -> str:
    """Of the text of its scenario and what was set over it."""
    stated = entry.result.summary.scenario
    return hashlib.sha256("\0".join([stated.text, *stated.overrides]).encode()).hexdigest()


OPTION = "--gate"
#: The worst outcome first.
_ORDER: tuple[GateOutcome, ...] = ("error", "failed", "undecided", "passed")


class HistoryGate(JudgedLimit):
    """A limit held against one tracker of the last result."""

    tracker: str
    against: int | None
    """Of the window, the result that it does worst against; None where there is none."""


def history_gates(
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
    present = [name for name in trackers if name in last.result]
    matches, refused = [], []
    for place in before:
        how, own = ways(place, len(entries) - 1), entries[place]
        if isinstance(how, str):
            refused.append(f"result {place + 1}: {how}")
            continue
        pairs = tuple((name, name) for name in present if name in own.result)
        matches.append(Match(last.result.name, last, own, place, how, pairs))
    allowed = {limit.metric: limit.percent for limit in limits}
    differing, missing = judged_differences(matches, [*metrics.values()], over_scenarios=True, limits=allowed)
    outcomes = gate_results(limits, metrics, differing, missing)
    lost = [name for name in trackers if before and name not in last.result and name in entries[-2].result]
    return [
        *(_worst(limit, name, outcomes, refused) for limit in limits for name in present),
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

"""Differences between trackers of results: which pairs are compared, their differences, and the verdicts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from trackbench.compare.comparability import Comparability
from trackbench.compare.comparison import Entrant, NotCompared, PairDifference
from trackbench.compare.entries import Entry
from trackbench.metrics import Metric
from trackbench.metrics.contrasts import Contrast, log_ratio, paired, unpaired
from trackbench.metrics.differences import (
    EQUIVALENT,
    MOST_PAIRED,
    UNDECIDED,
    corrected_p_values,
    difference_without_charged,
    margin_between,
    verdict_on_first,
)
from trackbench.metrics.intervals import Interval

#: Difference in the share of given estimates of two trackers above which a note names it.
NOTED = 0.01


@dataclass(frozen=True)
class Match:
    """Result, the baseline result that it is compared with (or itself), and the compared pairs of trackers."""

    scenario: str
    entry: Entry
    against: Entry
    number: int
    """Index of the set that ``entry`` belongs to; ``against`` belongs to set 0."""
    how: Comparability
    pairs: tuple[tuple[str, str], ...]
    selected: bool = False
    """Whether all trackers are compared with one tracker that may have been chosen as the best in the same data."""

    def choices(self, metric: Metric) -> float:
        """Return the factor on p-values for the choice of the best tracker in the same data; 0 without a choice."""
        return self.selected * len(self.pairs) * (0.5 if metric.ranks else 1.0)

    def entrants(self, pair: tuple[str, str]) -> tuple[Entrant, Entrant]:
        """Return both trackers of a pair, each with the index of its set of results."""
        return Entrant(tracker=pair[0], set=self.number), Entrant(tracker=pair[1])


def match_within(entry: Entry, trackers: Sequence[str], baseline: str | None = None) -> Match:
    """Pair the trackers of one result: each with the baseline if there is one, many with the best, else all pairs.

    Args:
        entry: the result.
        trackers: names of the trackers to compare.
        baseline: tracker that the user named, in place of the scenario's baseline or of the best. Where the scenario
            compares all pairs, all pairs stay compared: naming a baseline after seeing the results makes no p-value
            smaller.
    """
    how, score = Comparability.of_all(entry.result.summary.runs, ""), entry.result.summary.score
    names, stated = list(trackers), score.baseline if score.baseline in trackers else None
    if stated is None and len(names) <= MOST_PAIRED:
        return Match(entry.result.name, entry, entry, 0, how, tuple(combinations(names, 2)))
    against = baseline if baseline in trackers else stated
    selected = against is None or against != stated
    if against is None:
        contenders = [tracker.name for tracker in entry.result.contenders if tracker.name in names]
        names, against = (contenders, contenders[0]) if contenders else (names, names[0])
    pairs = tuple((name, against) for name in names if name != against)
    return Match(entry.result.name, entry, entry, 0, how, pairs, selected)


def same_tracker(ours: Sequence[str], theirs: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Pair each tracker of a later result with the baseline's tracker of equal name, or the only with the only one."""
    if len(ours) == len(theirs) == 1:
        return ((theirs[0], ours[0]),)
    return tuple((name, name) for name in ours if name in theirs)


def judged_differences(
    matches: Sequence[Match],
    metrics: Sequence[Metric],
    *,
    over_scenarios: bool,
    limits: Mapping[str, float] | None = None,
) -> tuple[list[PairDifference], list[NotCompared]]:
    """Return the difference of each compared pair by each metric, and the pairs in which a tracker has no value.

    The p-values are corrected for their number, over all metrics together: in all scenarios, or within each scenario
    and its worlds (variants of a scenario with other drivers and sensors). With several sets of results, pairs that are
    equal in every run do not count: they cannot be called different.

    Args:
        matches: results and pairs of trackers to compare.
        metrics: metrics to compare by.
        over_scenarios: whether the p-values of all scenarios are corrected together, as for several sets of results.
        limits: largest margin as a percentage of the value that is compared against, by metric.
    """
    compared: list[_Uncorrected] = []
    missing: list[NotCompared] = []
    families: dict[str, list[int]] = {}
    for metric, match in product(metrics, matches):
        for outcome in _compare(match, metric, (limits or {}).get(metric.path)):
            if isinstance(outcome, NotCompared):
                missing.append(outcome)
            elif over_scenarios and outcome.item.identical:
                compared.append(outcome)
            else:
                family = "" if over_scenarios else match.entry.result.summary.scenario.base
                families.setdefault(family, []).append(len(compared))
                compared.append(outcome)
    p_values: dict[int, float] = {}
    for places in families.values():
        members = [compared[place] for place in places]
        p = corrected_p_values([member.item.p_value for member in members], [member.choices for member in members])
        p_values |= dict(zip(places, p, strict=True))
    return [item.judged(p_values.get(place, 1.0)) for place, item in enumerate(compared)], missing


class _Uncorrected(NamedTuple):
    """Difference whose p-value is not corrected yet, with the data for the correction."""

    item: PairDifference
    contrast: Contrast
    metric: Metric
    choices: float

    def judged(self, p_value: float) -> PairDifference:
        """Return the difference with its corrected p-value, and the verdict that follows from this p-value."""
        if self.item.identical:
            verdict = EQUIVALENT
        else:
            verdict = verdict_on_first(self.contrast, p_value, self.metric.better, self.item.without_charged)
        return self.item.model_copy(update={"p_value": p_value, "verdict": verdict})


def _compare(match: Match, metric: Metric, limit: float | None) -> Iterator[_Uncorrected | NotCompared]:
    shared = match.how.shared
    intervals: dict[tuple[int, str], Interval | None] = {}
    over_stretches = match.entry.over_stretches(metric) and match.against.over_stretches(metric)
    for pair in match.pairs:
        sides = (match.entry, pair[0]), (match.against, pair[1])
        for (entry, tracker), runs in zip(sides, shared[::-1] if shared else (None, None), strict=True):
            if (id(entry), tracker) not in intervals:
                interval = entry.interval(tracker, metric, runs, over_stretches=over_stretches)
                # Numbers whose squares overflow are left out.
                finite = interval is not None and np.isfinite(np.square([interval.value, *interval.influence])).all()
                intervals[id(entry), tracker] = interval if finite else None
        first, second = (intervals[id(entry), tracker] for entry, tracker in sides)
        entrant, against = match.entrants(pair)
        if first is None or second is None:
            entry, tracker = sides[0] if first is None else sides[1]
            yield NotCompared(
                scenario=match.scenario,
                metric=metric.path,
                entrant=entrant,
                against=against,
                reason=f"{tracker} in {entry.label}: {entry.failure(tracker) or 'there is nothing to score'}",
                of_entrant=second is not None,
            )
            continue
        margin = margin_between(first, second, metric.unit, metric.better, match.against.result.summary.score.margin)
        if limit is not None:
            margin = min(margin, limit / 100 * abs(second.value))
        result = (unpaired if shared is None else paired)(first, second, margin)
        item = PairDifference(
            scenario=match.scenario,
            metric=metric.path,
            unit=metric.unit,
            entrant=entrant,
            against=against,
            value=first.value,
            reference=second.value,
            difference=result.value,
            ci95=result.ci95,
            margin=result.margin,
            p_value=result.p_value,
            without_charged=difference_without_charged(
                *(entry.result[tracker].metrics.get(metric.path) for entry, tracker in sides)
            ),
            paired_runs=None if shared is None else len(shared[0]),
            stretches=len(first.influence) if over_stretches else None,
            scenes=max(1, len(match.against.result.summary.truth.scenes)),
            few_scenes_decide=match.against.result.summary.truth.few_scenes_decide,
            scenes_in_words=match.against.result.summary.truth.scenes_in_words,
            repeatable=limit is not None and shared is not None and match.entry.repeatable,
            verdict=UNDECIDED,
            scenes_ahead=_scenes_ahead(match, pair) if metric.path == match.entry.result.summary.headline else None,
            log_ratio=log_ratio(first, second, is_paired=shared is not None),
        )
        # Rounding errors differ between machines.
        update = {"difference": 0.0, "ci95": item.ci95 and (0.0, 0.0)} if item.identical else {}
        yield _Uncorrected(item.model_copy(update=update), result, metric, match.choices(metric))


def differences_to(baseline: str, differences: Sequence[PairDifference]) -> list[PairDifference]:
    """Return the differences of all other trackers of a single set to the tracker ``baseline``."""
    turned = (item.turned() if item.entrant.tracker == baseline else item for item in differences)
    return [item for item in turned if item.against.tracker == baseline]


def _scenes_ahead(match: Match, pair: tuple[str, str]) -> tuple[int, int] | None:
    """Return in how many scenes the first tracker has the smaller error, and the number of all scenes; else None.

    The result is None with a single scene, or where the two results have different scenes.
    """
    scenes, scenes_of_other = (entry.result.summary.truth.scenes for entry in (match.entry, match.against))
    if len(scenes) < 2 or [scene.name for scene in scenes] != [scene.name for scene in scenes_of_other]:
        return None
    ahead = [
        scene.error[pair[0]] < against.error.get(pair[1], np.inf)
        for scene, against in zip(scenes, scenes_of_other, strict=True)
        if pair[0] in scene.error
    ]
    return sum(ahead), len(scenes)


def coverage_notes(
    matches: Sequence[Match], differences: Sequence[PairDifference], metrics: Sequence[Metric]
) -> Iterator[str]:
    """Yield notes on pairs with fewer estimates by one tracker, and if the charge for missing ones sets the sign."""
    compared = {(item.scenario, item.entrant, item.against) for item in differences}
    directed = [metric.path for metric in metrics if metric.better is not None]
    uncounted = [
        (item.scenario, item.entrant, item.against)
        for item in differences
        if item.metric in directed and item.verdict in ("larger", "smaller")
    ]
    for match in matches:
        for a, b in match.pairs:
            share_a, share_b = match.entry.coverage(a), match.against.coverage(b)
            pair = (match.scenario, *match.entrants((a, b)))
            if pair in compared and abs(share_a - share_b) > NOTED:
                but = "without the charge for missing estimates the order is reversed, so neither is called better"
                due = f"% of the estimates due in {match.scenario}"
                shares = f"{a} gave {100 * share_a:.0f} {due}, {b} {100 * share_b:.0f} %"
                yield f"{shares}; {but}" if pair in uncounted else shares

"""Ranking of trackers over scenarios: scores in each scenario, mean ranks, and tests of their differences.

The population are scenarios like the compared ones, with as many runs each. The parameter is a tracker's expected rank
in one of them, as its runs would show it. The ranks in one scenario contain the noise of its runs, and ranks in
different scenes are independent. So their spread contains both the choice of scenes and the noise within each.
Scenarios that share scenes, such as the same traffic with and without a lidar, are one set, and count once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.special import stdtrit

from trackbench.base.types import Array, Indices
from trackbench.compare.comparison import Entrant, EntrantScore, PairDifference, RankDifference, RankedTracker
from trackbench.compare.entries import Entry
from trackbench.metrics.differences import LEVEL, holm

#: Metrics that a score always keeps, by the metric that ranks.
SHOWN = {
    "position_rmse": ("position_rmse", "velocity_rmse", "position_over_reference", "nees", "step_time"),
    "tgospa": (
        "tgospa", "gospa_switch", "gospa", "gospa_localisation", "gospa_missed", "gospa_false", "hota", "id_switches",
        "step_time",
    ),
}  # fmt: skip


class Pairings:
    """Verdicts on pairs of trackers in each scenario, by the metric that ranks trackers."""

    def __init__(self, differences: Sequence[PairDifference], metric: str) -> None:
        self.metric = metric
        self._better: dict[tuple[str, frozenset[str]], str | None] = {}
        for item in differences:
            a, b = item.entrant.tracker, item.against.tracker
            if item.metric == metric:
                better = {"better": a, "worse": b}.get(item.verdict)
                self._better[item.scenario, frozenset((a, b))] = better

    def better(self, scenario: str, a: str, b: str) -> str | None:
        """Return the one of two trackers that is shown to be better in a scenario; None where neither is."""
        return self._better.get((scenario, frozenset((a, b))))

    def compared(self, scenario: str, a: str, b: str) -> bool:
        """Return whether the two trackers were compared in a scenario."""
        return (scenario, frozenset((a, b))) in self._better

    def rank(self, scenario: str, name: str, names: Sequence[str]) -> float:
        """Return the rank among ``names``: 1, plus 1 for each better tracker, plus 1/2 for each undecided one."""
        winners = [self.better(scenario, name, other) for other in names if other != name]
        return 1.0 + sum(0.5 if better is None else float(better != name) for better in winners)


def entrant_scores(
    number: int,
    entry: Entry,
    scenario: str,
    trackers: Sequence[str],
    pairings: Pairings | None,
    compared: Sequence[str] = (),
) -> list[EntrantScore]:
    """Return the scores of the trackers of one result, in the order of the scenario; ranked if ``pairings`` are given.

    ``compared``: paths of metrics to keep beside those that are always shown.
    """
    scored = [tracker.name for tracker in entry.result.scored if tracker.name in trackers]
    contenders = [tracker.name for tracker in entry.result.contenders if tracker.name in trackers]
    shown = dict.fromkeys([*SHOWN[entry.result.summary.headline], *(path.removesuffix(".mean") for path in compared)])
    entrants = []
    for tracker in entry.result.summary.trackers:
        name = tracker.name
        if name not in trackers:
            continue
        has_score = name in scored
        ranked = pairings if has_score else None
        metrics = {path: value for path in shown if (value := tracker.metrics.get(path)) and value.value is not None}
        entrants.append(
            EntrantScore(
                scenario=scenario,
                entrant=Entrant(tracker=name, set=number),
                metrics=metrics if has_score else {},
                diverged_runs=(tracker.health.diverged_runs or 0) if has_score else 0,
                rank=None if ranked is None else ranked.rank(scenario, name, contenders),
                leading=ranked is not None and name in contenders and _leads(name, contenders[0], scenario, ranked),
                reference=tracker.is_reference and name not in contenders,
                failure="" if has_score else entry.result.why_unscored(tracker),
            )
        )
    return entrants


def _leads(name: str, best: str, scenario: str, pairings: Pairings) -> bool:
    """Return whether a tracker is the best of a scenario, or was compared with the best and not shown to be worse."""
    return name == best or (
        pairings.compared(scenario, best, name) and pairings.better(scenario, best, name) in (None, name)
    )


def sets_of_scenes(scenes: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Return the scenarios grouped where they share scenes, directly or through others, in the order of the first.

    Args:
        scenes: fingerprints of the scenes of each scenario; a scenario without any is a set of its own.
    """
    sets: list[list[str]] = []
    for name, fingerprints in scenes.items():
        shared = [group for group in sets if any(_share(fingerprints, scenes[member]) for member in group)]
        if not shared:
            sets.append([name])
            continue
        shared[0].extend([*(member for group in shared[1:] for member in group), name])
        sets = [group for group in sets if group not in shared[1:]]
    return sets


def _share(first: Sequence[str], second: Sequence[str]) -> bool:
    """Return whether two lists of scene fingerprints have a scene in common, perhaps recorded for different times."""
    return any(a.startswith(b) or b.startswith(a) for a in first for b in second)


def ranked_trackers(
    scored: Sequence[EntrantScore], pairings: Pairings, sets: Sequence[Sequence[str]]
) -> tuple[list[RankedTracker], list[RankDifference]]:
    """Return the trackers of one set of results by mean rank, and the tests of every two mean ranks.

    If mean ranks are equal, the smaller geometric mean of the errors is first. References stand after the others, which
    are ranked without them. Trackers without a score in a scenario share its last places. Where a scenario lacks some
    trackers, the rank is scaled to the whole field. The rank in a set of scenarios is the mean of the ranks in each.

    Args:
        scored: scores of every tracker in every scenario.
        pairings: verdicts on pairs of trackers.
        sets: names of scenarios, grouped where they share scenes.
    """
    references = {score.entrant.tracker for score in scored if score.reference}
    competing = [score for score in scored if score.entrant.tracker not in references]
    ranked, differences = _ranking(competing, pairings, sets)
    for reference in sorted(references):
        its_scores = [score for score in scored if score.entrant.tracker == reference]
        beside, _ = _ranking([*competing, *its_scores], pairings, sets)
        (item,) = (item for item in beside if item.tracker == reference)
        ranked.append(item.model_copy(update={"reference": True, "ci95": None}))
    return ranked, differences


def _ranking(
    scored: Sequence[EntrantScore], pairings: Pairings, sets: Sequence[Sequence[str]]
) -> tuple[list[RankedTracker], list[RankDifference]]:
    by_scenario: dict[str, dict[str, EntrantScore]] = {}
    for score in scored:
        by_scenario.setdefault(score.scenario, {})[score.entrant.tracker] = score
    names = list(dict.fromkeys(score.entrant.tracker for score in scored))
    number = {scenario: number for number, members in enumerate(sets) for scenario in members}
    member_of = np.array([number[scenario] for scenario in by_scenario])
    ranks = _by_set(np.array([_ranks(scenario, names) for scenario in by_scenario.values()]), member_of)
    ranked = []
    for i, name in enumerate(names):
        its_scores = [scenario[name] for scenario in by_scenario.values() if name in scenario]
        verdicts = [nees.verdict for score in its_scores if (nees := score.metrics.get("nees"))]
        judged = [verdict for verdict in verdicts if verdict not in (None, "undecided")]
        outcomes = [
            _outcome(scenario, name, other, pairings)
            for scenario in by_scenario.values()
            for other in (scenario if name in scenario else ())
            if other != name
        ]
        its_ranks = ranks[np.isfinite(ranks[:, i]), i]
        ranked.append(
            RankedTracker(
                tracker=name,
                scenarios=len(its_scores),
                mean_rank=float(its_ranks.mean()),
                ci95=_telling(mean_rank_interval(its_ranks, len(names)), len(names)),
                won=outcomes.count("won"),
                lost=outcomes.count("lost"),
                tied=outcomes.count("tied"),
                consistent_scenarios=judged.count("consistent"),
                judged_scenarios=len(judged),
                diverged_runs=sum(score.diverged_runs for score in its_scores),
                failed_scenarios=sum(score.rank is None for score in its_scores),
            )
        )
    sizes = _relative_errors([*by_scenario.values()], pairings.metric)
    ranked.sort(key=lambda item: (round(item.mean_rank, 9), sizes.get(item.tracker, 0.0), item.tracker))
    order = [item.tracker for item in ranked]
    if len(ranks) < 2:
        return ranked, []
    return ranked, _rank_differences(order, [*by_scenario.values()], member_of, pairings)


def _relative_errors(scenarios: Sequence[dict[str, EntrantScore]], metric: str) -> dict[str, float]:
    """Return for each tracker the mean over scenarios of ln(error / geometric mean error of the scenario)."""
    relative: dict[str, list[float]] = {}
    for scores in scenarios:
        logarithms = {
            name: np.log(value) for name, score in scores.items() if (value := score.value(metric) or 0.0) > 0
        }
        for name, logarithm in logarithms.items():
            relative.setdefault(name, []).append(logarithm - np.mean([*logarithms.values()]))
    return {name: float(np.mean(values)) for name, values in relative.items()}


def _telling(interval: tuple[float, float] | None, trackers: int) -> tuple[float, float] | None:
    """Return the interval of a mean rank; None if it has no width or covers all ranks."""
    return interval if interval and interval[0] < interval[1] and interval != (1.0, trackers) else None


def _by_set(values: Array, member_of: Indices) -> Array:
    """Average values ``(scenarios, k)`` over the scenarios of each set, to ``(sets, k)``; NaN where all are NaN."""
    rows = [values[member_of == number] for number in np.unique(member_of)]
    counts = np.array([np.isfinite(row).sum(axis=0) for row in rows])
    totals = np.array([np.nansum(row, axis=0) for row in rows])
    return np.where(counts > 0, totals / np.maximum(counts, 1), np.nan)


def _rank_differences(
    names: Sequence[str], scenarios: Sequence[dict[str, EntrantScore]], member_of: Indices, pairings: Pairings
) -> list[RankDifference]:
    """Test every pair of trackers, by the pairings of these two alone: other trackers change nothing.

    Source: Benavoli, Corani and Mangili (2016), "Should we really use post-hoc tests based on mean-ranks?"
    """
    pairs = [*combinations(names, 2)]
    if not pairs:
        return []
    won = {"won": -1.0, "tied": 0.0, "lost": 1.0}
    each = np.array([[won[_outcome(scenario, a, b, pairings)] for a, b in pairs] for scenario in scenarios])
    outcomes = _by_set(each, member_of).T
    return [
        RankDifference(a=a, b=b, p_value=p_value, shown=p_value < LEVEL)
        for (a, b), p_value in zip(pairs, holm(sign_flip(outcomes).tolist()), strict=True)
    ]


def _ranks(scenario: dict[str, EntrantScore], names: Sequence[str]) -> list[float]:
    """Return each tracker's rank in one scenario, scaled to the whole field; NaN for one that did not take part."""
    ranked = sum(score.rank is not None for score in scenario.values())
    last = (ranked + 1 + len(scenario)) / 2
    scale = (len(names) - 1) / max(1, len(scenario) - 1)
    ranks = []
    for name in names:
        score = scenario.get(name)
        rank = np.nan if score is None else last if score.rank is None else score.rank
        ranks.append(1 + scale * (rank - 1))
    return ranks


def _outcome(scenario: dict[str, EntrantScore], name: str, against: str, pairings: Pairings) -> str:
    """Return ``won``, ``lost`` or ``tied``. Without a score a tracker loses to one with a score; an absent one ties."""
    ours, theirs = scenario.get(name), scenario.get(against)
    if ours is None or theirs is None:
        return "tied"
    if (ours.rank is None) != (theirs.rank is None):
        return "won" if theirs.rank is None else "lost"
    better = pairings.better(ours.scenario, name, against)
    return "tied" if better is None else "won" if better == name else "lost"


#: Part of a set of scenes, in which every tracker has the middle rank, that is added for the interval.
PSEUDO = 0.5
#: Least numbers of sets and of trackers for an interval: with fewer, ranks take so few values that it covers anything
#: from 60 to 100 %.
FEWEST_SETS, FEWEST_TRACKERS = 3, 4
#: Largest number of sets for which all signs are tried; for more they are drawn.
ALL_SIGNS = 14
DRAWN_SIGNS = 20_000


def mean_rank_interval(ranks: Array, trackers: int) -> tuple[float, float] | None:
    """Return the 95 % interval of a tracker's mean rank; None with fewer than 3 sets of scenes or 4 trackers.

    It is Student's interval with half a set added in which the tracker has the middle rank. Without it a tracker that
    is first in each of a few sets would seem to be first in all sets. The idea is from Agresti and Coull (1998),
    "Approximate is better than exact for interval estimation of binomial proportions".

    Args:
        ranks: ``(sets,)`` rank of the tracker in each set.
        trackers: number of ranked trackers.
    """
    if len(ranks) < FEWEST_SETS or trackers < FEWEST_TRACKERS:
        return None
    middle = (trackers + 1) / 2
    size = len(ranks) + PSEUDO
    mean = (ranks.sum() + PSEUDO * middle) / size
    variance = (((ranks - mean) ** 2).sum() + PSEUDO * (middle - mean) ** 2) / (size - 1)
    reach = stdtrit(size - 1, 0.975) * np.sqrt(variance / size)
    return float(max(mean - reach, 1.0)), float(min(mean + reach, trackers))


def sign_flip(differences: Array) -> Array:
    """Return the two-sided p-values ``(pairs,)`` of the hypothesis that two trackers have the same expected rank.

    Under the hypothesis each difference could as well have the other sign. The p-value is the share of all choices of
    signs whose sum is at least as far from zero. It is exact for trackers that are alike, however few sets there are,
    and no smaller than 2 to the power of 1 - sets. Source: Fisher (1935), "The Design of Experiments", section 21; with
    drawn signs Phipson and Smyth (2010), "Permutation p-values should never be zero".

    Args:
        differences: ``(pairs, sets)`` differences of the ranks of two trackers; 0 where one did not take part.
    """
    sets = differences.shape[1]
    if sets <= ALL_SIGNS:
        signs = 1.0 - 2.0 * (np.arange(2**sets)[:, None] >> np.arange(sets) & 1)
    else:
        drawn = np.random.default_rng(0).choice([1.0, -1.0], (DRAWN_SIGNS, sets))
        signs = np.vstack([np.ones(sets), drawn])
    observed = np.abs(differences.sum(axis=1, keepdims=True))
    # Rounding must not make an equal sum smaller.
    shares: Array = (np.abs(differences @ signs.T) >= observed - 1e-9).mean(axis=1)
    return shares


def fewest_sets(trackers: int) -> int:
    """Return the least number of sets of scenes with which any two of ``trackers`` trackers can be shown to differ."""
    pairs = trackers * (trackers - 1) / 2
    return next(count for count in range(1, 100) if pairs * 2.0 ** (1 - count) < LEVEL)

"""Trackers over scenarios: what each reached where, and who is ahead, with how much certainty."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.compare.comparison import Entrant, EntrantScore, PairDifference, RankedTracker
from trackbench.compare.entries import Entry
from trackbench.types import Array

RESAMPLES = 10_000
#: The metric that trackers are ranked by.
RANKED_BY = "position_rmse"
#: The metrics that a score keeps.
SHOWN = ("position_rmse", "velocity_rmse", "position_over_reference", "nees", "step_time")


class Pairings:
    """Which of two trackers is better in a scenario."""

    def __init__(self, differences: Sequence[PairDifference]) -> None:
        self._better: dict[tuple[str, frozenset[str]], str] = {}
        for item in differences:
            a, b = item.entrant.tracker, item.against.tracker
            if item.metric == RANKED_BY and item.verdict in ("better", "worse"):
                self._better[item.scenario, frozenset((a, b))] = a if item.verdict == "better" else b

    def better(self, scenario: str, a: str, b: str) -> str | None:
        """The better one of the two, None where none is shown to be."""
        return self._better.get((scenario, frozenset((a, b))))


def scores(number: int, entry: Entry, scenario: str, trackers: Sequence[str], pairings: Pairings) -> list[EntrantScore]:
    """What the trackers of one result reached, in the order of the scenario."""
    scored = [tracker.name for tracker in entry.result.scored if tracker.name in trackers]
    found = []
    for tracker in entry.result.summary.trackers:
        name = tracker.name
        if name not in trackers:
            continue
        rank = scored.index(name) + 1 if name in scored else None
        metrics = {path: value for path in SHOWN if (value := tracker.metrics.get(path)) and value.value is not None}
        found.append(
            EntrantScore(
                scenario=scenario,
                entrant=Entrant(tracker=name, set=number),
                metrics=metrics if rank else {},
                diverged_runs=(tracker.health.diverged_runs or 0) if rank else 0,
                rank=rank,
                leading=rank is not None and pairings.better(scenario, scored[0], name) in (None, name),
                failure="" if rank else entry.result.why_unscored(tracker),
            )
        )
    return found


def ranking(scored: Sequence[EntrantScore], pairings: Pairings) -> list[RankedTracker]:
    """Every tracker of one set of results, by mean rank.

    A tracker's rank in a scenario is one plus the number of trackers with a smaller position RMSE; those without a
    score share the last place. Where a scenario lacks some trackers, the place is scaled to the whole field. The
    interval of the mean and the certainty of the lead come from drawing the scenarios anew with replacement
    (bootstrap): they say how much the order hangs on the choice of scenarios, not on the noise within them.
    """
    by_scenario: dict[str, dict[str, EntrantScore]] = {}
    for score in scored:
        by_scenario.setdefault(score.scenario, {})[score.entrant.tracker] = score
    names = list(dict.fromkeys(score.entrant.tracker for score in scored))
    ranks = np.array([_ranks(scenario, names) for scenario in by_scenario.values()])
    draws = _resampled_means(ranks) if len(ranks) > 1 else None
    lead = None if draws is None else _first_shares(draws)
    found = []
    for i, name in enumerate(names):
        own = [scenario[name] for scenario in by_scenario.values() if name in scenario]
        verdicts = [nees.verdict for score in own if (nees := score.metrics.get("nees"))]
        judged = [verdict for verdict in verdicts if verdict not in (None, "undecided")]
        outcomes = [outcome for scenario in by_scenario.values() for outcome in _outcomes(scenario, name, pairings)]
        interval = None if draws is None else np.nanquantile(draws[:, i], [0.025, 0.975])
        found.append(
            RankedTracker(
                tracker=name,
                scenarios=len(own),
                mean_rank=float(np.nanmean(ranks[:, i])),
                ci95=None if interval is None else (float(interval[0]), float(interval[1])),
                first_share=None if lead is None else float(lead[i]),
                won=outcomes.count("won"),
                lost=outcomes.count("lost"),
                undecided=outcomes.count("undecided"),
                consistent_scenarios=judged.count("consistent"),
                judged_scenarios=len(judged),
                diverged_runs=sum(score.diverged_runs for score in own),
                failed_scenarios=sum(score.rank is None for score in own),
            )
        )
    return sorted(found, key=lambda item: (item.mean_rank, item.tracker))


def _ranks(scenario: dict[str, EntrantScore], names: Sequence[str]) -> list[float]:
    """The place of each tracker in the whole field, NaN where it did not take part."""
    others = max(1, len(scenario) - 1)
    ranked = sum(score.rank is not None for score in scenario.values())
    ranks = []
    for name in names:
        score = scenario.get(name)
        ahead = np.nan if score is None else ranked if score.rank is None else score.rank - 1
        ranks.append(1 + (len(names) - 1) * float(ahead) / others)
    return ranks


def _resampled_means(ranks: Array) -> Array:
    """``(RESAMPLES, trackers)`` mean ranks, NaN where no drawn scenario has the tracker."""
    count = len(ranks)
    weights = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    present = np.isfinite(ranks)
    taken = weights @ present
    total = weights @ np.where(present, ranks, 0.0)
    means: Array = total / np.where(taken > 0, taken, np.nan)
    return means


def _first_shares(draws: Array) -> Array:
    """How often each tracker leads; draws led by several count in part for each."""
    first = np.isclose(draws, np.nanmin(draws, axis=1, keepdims=True))
    shares: Array = (first / first.sum(axis=1, keepdims=True)).mean(axis=0)
    return shares


def _outcomes(scenario: dict[str, EntrantScore], name: str, pairings: Pairings) -> Iterator[str]:
    """A tracker's pairings in a scenario; one without a score loses against one that has one."""
    own = scenario.get(name)
    for other in scenario.values() if own is not None else ():
        assert own is not None
        if other is own:
            continue
        if (own.rank is None) != (other.rank is None):
            yield "won" if other.rank is None else "lost"
            continue
        better = pairings.better(own.scenario, name, other.entrant.tracker)
        yield "undecided" if better is None else "won" if better == name else "lost"

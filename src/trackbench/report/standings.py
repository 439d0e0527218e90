"""How trackers compare over scenarios: what each reached where, and who is ahead overall, with how much certainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.report.significance import Differences
from trackbench.report.wording import failure, scored
from trackbench.results import Result
from trackbench.types import Array

RESAMPLES = 10_000


@dataclass(frozen=True)
class Score:
    """What one tracker reached in one scenario."""

    position_rmse: float | None
    """m; None without a score."""
    ci95: tuple[float, float] | None
    efficiency: float | None
    nees: float | None
    nees_verdict: str | None
    diverged_runs: int
    rank: int | None
    leading: bool
    """Whether it is the best of the scenario, or no difference from the best was shown."""
    failure: str | None
    """Why there is no score."""


@dataclass(frozen=True)
class ScenarioScores:
    """One scenario."""

    name: str
    description: str
    runs: int
    seed: int
    expectations: int
    expectations_met: int
    scores: dict[str, Score]
    """By tracker."""


@dataclass(frozen=True)
class Standing:
    """One tracker over all its scenarios."""

    tracker: str
    scenarios: int
    mean_rank: float
    ci95: tuple[float, float] | None
    """Of the mean rank, scenarios drawn anew; None for one scenario."""
    first_share: float | None
    """Share of the draws in which it has the best mean rank."""
    won: int
    """Pairings with another tracker in a scenario in which its error is really smaller."""
    lost: int
    undecided: int
    consistent: int
    """Scenarios in which its covariance is as large as its errors."""
    judged: int
    """Scenarios in which that could be judged."""
    diverged_runs: int
    failed: int
    """Scenarios without a score."""


def scenario_scores(result: Result) -> ScenarioScores:
    """What a run found, reduced to what a comparison needs."""
    summary = result.json()
    order = [tracker["name"] for tracker in scored(summary)]
    differences = Differences(summary["differences"])
    return ScenarioScores(
        name=summary["scenario"]["name"],
        description=summary["scenario"]["description"],
        runs=summary["runs"],
        seed=summary["seed"],
        expectations=len(summary["expectations"]),
        expectations_met=sum(item["passed"] for item in summary["expectations"]),
        scores={t["name"]: _score(t, order, differences) for t in summary["trackers"]},
    )


def _score(tracker: Mapping[str, Any], order: Sequence[str], differences: Differences) -> Score:
    name, metrics = tracker["name"], tracker["metrics"]
    if name not in order:
        return Score(None, None, None, None, None, 0, None, False, failure(tracker))
    ci95 = metrics["position_rmse"].get("ci95")
    return Score(
        position_rmse=metrics["position_rmse"]["value"],
        ci95=(ci95[0], ci95[1]) if ci95 else None,
        efficiency=metrics["position_efficiency"]["value"],
        nees=metrics["nees"]["mean"],
        nees_verdict=metrics["nees"].get("verdict"),
        diverged_runs=tracker["health"]["diverged_runs"],
        rank=order.index(name) + 1,
        leading=name == order[0] or not differences.real(order[0], name),
        failure=None,
    )


def standings(results: Sequence[Result], scenarios: Sequence[ScenarioScores]) -> list[Standing]:
    """Every tracker's standing, by mean rank.

    A tracker's rank in a scenario is one plus the number of trackers with a smaller position RMSE; those without a
    score share the last place. Where a scenario lacks some trackers, the place is scaled to the whole field. The
    interval of the mean and the certainty of the lead come from drawing the scenarios anew with replacement
    (bootstrap): they say how much the order hangs on the choice of scenarios, not on the noise within them.
    """
    names = list(dict.fromkeys(name for scenario in scenarios for name in scenario.scores))
    ranks = np.array([_ranks(scenario, names) for scenario in scenarios])
    draws = _resampled_means(ranks) if len(scenarios) > 1 else None
    lead = _first_shares(draws) if draws is not None else None
    pairings = _pairings(results, scenarios, names)
    found = []
    for i, name in enumerate(names):
        scores = [scenario.scores[name] for scenario in scenarios if name in scenario.scores]
        verdicts = [score.nees_verdict for score in scores if score.nees_verdict not in (None, "undecided")]
        interval = None if draws is None else np.nanquantile(draws[:, i], [0.025, 0.975])
        won, lost, undecided = pairings[name]
        found.append(
            Standing(
                tracker=name,
                scenarios=len(scores),
                mean_rank=float(np.nanmean(ranks[:, i])),
                ci95=None if interval is None else (float(interval[0]), float(interval[1])),
                first_share=None if lead is None else float(lead[i]),
                won=won,
                lost=lost,
                undecided=undecided,
                consistent=verdicts.count("consistent"),
                judged=len(verdicts),
                diverged_runs=sum(score.diverged_runs for score in scores),
                failed=sum(score.rank is None for score in scores),
            )
        )
    return sorted(found, key=lambda standing: (standing.mean_rank, standing.tracker))


def _ranks(scenario: ScenarioScores, names: Sequence[str]) -> list[float]:
    """The place of each tracker in the whole field, NaN where it did not take part."""
    others = max(1, len(scenario.scores) - 1)
    ranked = sum(score.rank is not None for score in scenario.scores.values())
    ranks = []
    for name in names:
        score = scenario.scores.get(name)
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


def _pairings(
    results: Sequence[Result], scenarios: Sequence[ScenarioScores], names: Sequence[str]
) -> dict[str, tuple[int, int, int]]:
    """Won, lost and undecided pairings; one without a score loses against one that has one."""
    table = {name: [0, 0, 0] for name in names}
    for result, scenario in zip(results, scenarios, strict=True):
        differences = Differences(result.json()["differences"])
        for a, own in scenario.scores.items():
            for b, other in scenario.scores.items():
                if a != b:
                    table[a][_outcome(a, b, own, other, differences)] += 1
    return {name: (won, lost, undecided) for name, (won, lost, undecided) in table.items()}


def _outcome(a: str, b: str, own: Score, other: Score, differences: Differences) -> int:
    """0 won, 1 lost, 2 undecided."""
    if (own.rank is None) != (other.rank is None):
        return 0 if other.rank is None else 1
    pair = differences.get(a, b)
    if pair is None or pair.better is None:
        return 2
    return 0 if pair.better == a else 1

"""Mean ranks over scenarios"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.compare.comparison import Entrant, EntrantScore, PairDifference
from trackbench.compare.ranking import FEWEST_SETS, Pairings, mean_rank_interval, ranked_trackers, sign_flip
from trackbench.metrics import BUILT_IN
from trackbench.metrics.differences import LEVEL, holm, tracker_differences
from trackbench.metrics.intervals import ratio, root
from trackbench.results import Difference
from trackbench.results.scenario_summary import MarginSummary

from .claim import Claim, power, rate

TRIALS = 2000
#: Trials that give the expected ranks.
MANY = 40_000
MARGIN = MarginSummary(percent=1.0, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
#: Of the errors' logarithms: what suits a tracker in a scenario, and the standard error from its runs.
SUITS = 1.0
NOISES = (0.05, 0.5)
SCENARIOS = (2, 3, 5, 13)
#: How much smaller the errors of the tracker are whose lead is to be shown, in their logarithm.
AHEAD = 1.5
#: Mean logarithms of the errors, in units of what suits a tracker in a scenario.
FIELDS = {
    "six equal trackers": [0.0] * 6,
    "six trackers a little apart": [0.0, 0.2, 0.4, 0.6, 0.8, 1.0],
    "six trackers far apart": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    "thirteen trackers": [0.25 * i for i in range(13)],
}


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for trackers in (2, 6):
        for scenarios in SCENARIOS:
            shown = [_lead_shown(random, trackers, scenarios) for _ in range(TRIALS // 4)]
            yield rate(f"{trackers} equal trackers, {scenarios} scenarios: the lead of one shown", shown, 0.0, LEVEL)
            shown = [_lead_shown(random, trackers, scenarios, AHEAD) for _ in range(TRIALS // 20)]
            least = 0.8 if scenarios == SCENARIOS[-1] else 0.0
            yield power(f"{trackers} trackers, one far ahead, {scenarios} scenarios: its lead shown", shown, least)
    for trackers in (2, 6):
        for noise in NOISES:
            for scenarios in SCENARIOS:
                outcomes = _outcomes(random, TRIALS, scenarios, np.zeros(trackers), noise)
                what = f"{trackers} equal trackers, {scenarios} scenarios, noise {noise:g}: a difference shown"
                yield rate(what, [_any_shown(one) for one in outcomes], 0.0, LEVEL)
                ahead = np.array([-AHEAD, *[0.0] * (trackers - 1)])
                outcomes = _outcomes(random, TRIALS // 5, scenarios, ahead, noise)
                what = f"{trackers} trackers, one ahead, {scenarios} scenarios, noise {noise:g}: a difference shown"
                yield power(what, [_any_shown(one) for one in outcomes])
    # Two trackers that win as often as each other and are not alike: others beside them must change nothing.
    for scenarios in SCENARIOS:
        means, spread = np.array([0.0, 0.0, -9.0, 9.0]), np.array([1.0, 4.0, 1.0, 1.0])
        outcomes = _outcomes(random, TRIALS, scenarios, means, 0.5, spread)
        shown = [_any_shown(one[:, :2, :2]) for one in outcomes]
        yield rate(f"2 trackers that win equally often, {scenarios} scenarios: a difference shown", shown, 0.0, LEVEL)
        outcomes = _outcomes(random, TRIALS // 5, scenarios, means - np.array([2 * AHEAD, 0.0, 0.0, 0.0]), 0.5, spread)
        shown = [_any_shown(one[:, :2, :2]) for one in outcomes]
        yield power(f"2 trackers of which one wins more often, {scenarios} scenarios: a difference shown", shown)
    for name, means in FIELDS.items():
        for noise in NOISES:
            expected = _ranks(random, MANY, 1, np.array(means), noise).mean(axis=(0, 1))
            for scenarios in (count for count in SCENARIOS if count >= FEWEST_SETS):
                ranks = _ranks(random, TRIALS, scenarios, np.array(means), noise)
                inside = [_covered(one, expected) for one in ranks]
                what = f"{name}, {scenarios} scenarios, noise {noise:g}: interval of a mean rank covers"
                yield rate(what, [float(np.mean(one)) for one in inside], 0.93, 1.0)


def _lead_shown(random: np.random.Generator, trackers: int, scenarios: int, ahead: float = 0.0) -> bool:
    """Of trackers each of which suits some scenarios better than others, by their errors in 20 runs of each; ``ahead``:
    how much smaller the logarithm of the first one's errors is."""
    names = "abcdef"[:trackers]
    found: list[PairDifference] = []
    for scenario in range(scenarios):
        suits, common = 0.3 * random.normal(size=trackers), 0.3 * random.normal(size=20)
        suits[0] -= ahead
        errors = {
            name: {"position_rmse": root(ratio(np.exp(common + suit + 0.3 * random.normal(size=20)), np.ones(20)))}
            for name, suit in zip(names, suits, strict=True)
        }
        found += [
            _difference(str(scenario), item)
            for item in tracker_differences(errors, BUILT_IN, MARGIN, {name: {} for name in errors})
        ]
    pairings = Pairings(found, "position_rmse")
    places = [(str(scenario), name) for scenario in range(scenarios) for name in names]
    scored = [_score(scenario, name, pairings.rank(scenario, name, names)) for scenario, name in places]
    ranked, pairs = ranked_trackers(scored, pairings, [[str(scenario)] for scenario in range(scenarios)])
    return bool(pairs) and all(item.shown for item in pairs if ranked[0].tracker in (item.a, item.b))


def _difference(scenario: str, item: Difference) -> PairDifference:
    verdict = {item.a: "better", item.b: "worse"}.get(item.better or "", item.verdict)
    return PairDifference(
        scenario=scenario,
        metric=item.metric,
        unit=item.unit,
        entrant=Entrant(tracker=item.a),
        against=Entrant(tracker=item.b),
        value=item.value,
        reference=0.0,
        difference=item.value,
        ci95=item.ci95,
        margin=item.margin,
        p_value=item.p_value,
        paired_runs=20,
        scenes=1,
        verdict=verdict,
    )


def _score(scenario: str, name: str, rank: float) -> EntrantScore:
    entrant = Entrant(tracker=name)
    return EntrantScore(scenario=scenario, entrant=entrant, metrics={}, diverged_runs=0, rank=rank, leading=False)


def _ranks(
    random: np.random.Generator,
    trials: int,
    scenarios: int,
    means: np.ndarray,
    noise: float,
    spread: float | np.ndarray = SUITS,
) -> np.ndarray:
    """``(trials, scenarios, trackers)`` ranks."""
    outcomes = _outcomes(random, trials, scenarios, means, noise, spread)
    # Of the diagonal a half is counted too.
    ranks: np.ndarray = 0.5 + (0.5 + 0.5 * outcomes).sum(axis=-1)
    return ranks


def _outcomes(
    random: np.random.Generator,
    trials: int,
    scenarios: int,
    means: np.ndarray,
    noise: float,
    spread: float | np.ndarray = SUITS,
) -> np.ndarray:
    """``(trials, scenarios, trackers, trackers)`` 1 where the first is worse than the second, -1 better, 0 not shown.

    It is shown where two estimates are far enough apart.
    """
    size = trials, scenarios, len(means)
    errors = means + spread * random.normal(size=size) + noise * random.normal(size=size)
    apart = errors[..., :, None] - errors[..., None, :]
    shown = np.abs(apart) > 2.0 * np.sqrt(2.0) * noise
    found: np.ndarray = np.where(shown, np.sign(apart), 0.0)
    return found


def _any_shown(outcomes: np.ndarray) -> bool:
    first, second = np.triu_indices(outcomes.shape[1], 1)
    return min(holm(sign_flip(outcomes[:, first, second].T).tolist())) < LEVEL


def _covered(ranks: np.ndarray, expected: np.ndarray) -> list[bool]:
    """Whether the interval of each tracker holds its expected rank, but for what that itself is not known by."""
    found = [mean_rank_interval(own, ranks.shape[1]) for own in ranks.T]
    return [
        ends is not None and ends[0] - 0.01 <= value <= ends[1] + 0.01
        for ends, value in zip(found, expected, strict=True)
    ]

"""Ratios pooled over scenarios."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.compare.comparison import Entrant, EntrantScore, PairDifference
from trackbench.compare.pooled import overall, pooled
from trackbench.metrics.contrasts import LogRatio, log_ratio
from trackbench.metrics.intervals import ratio, root


def test_the_interval_of_one_ratio_is_that_of_a_paired_t_test_of_relative_differences() -> None:
    random = np.random.default_rng(2)
    a, b = random.normal(2.0, 0.1, 12), random.normal(1.0, 0.1, 12)
    made = log_ratio(ratio(a, np.ones(12)), ratio(b, np.ones(12)), is_paired=True)
    assert made is not None
    assert made.value == pytest.approx(np.log(a.mean() / b.mean()))
    assert made.error == pytest.approx(np.std(a / a.mean() - b / b.mean(), ddof=1) / 12**0.5)
    assert pooled([made], [0]) == (made.value, pytest.approx(2.200985 * made.error))


def test_scenarios_that_share_scenes_tell_no_more_than_one() -> None:
    ratios = [LogRatio(0.1, 0.02, 19), LogRatio(0.3, 0.02, 19)]
    mean, together = pooled(ratios, [0, 0])
    assert mean == pytest.approx(0.2)
    assert together == pytest.approx(2.093024 * 0.02)
    _, apart = pooled(ratios, [0, 1])
    assert apart == pytest.approx(2.024394 * 0.02 / 2**0.5)
    # Of what is the same in every run nothing is uncertain; what has no interval gives none.
    assert pooled([ratios[0], LogRatio(0.0, 0.0, 1)], [0, 1])[1] == pytest.approx(2.093024 * 0.01)
    assert pooled([ratios[0], LogRatio(0.0, None, 0)], [0, 1]) == (pytest.approx(0.05), None)


def test_ninety_five_per_cent_of_the_intervals_hold_the_ratio() -> None:
    random, truth = np.random.default_rng(1), np.array([-0.2, 0.0, 0.3])
    inside = []
    for _ in range(1000):
        common = random.normal(size=(3, 15))
        a, b = (1.0 + 0.1 * (common + random.normal(size=(3, 15))) for _ in "ab")
        ratios = [
            log_ratio(root(ratio(np.exp(2 * size) * x, np.ones(15))), root(ratio(y, np.ones(15))), is_paired=True)
            for size, x, y in zip(truth, a, b, strict=True)
        ]
        mean, reach = pooled([item for item in ratios if item], range(3))
        inside.append(abs(mean - truth.mean()) <= (reach or 0.0))
    assert 0.935 < np.mean(inside) < 0.965


def difference(scenario: str, tracker: str) -> PairDifference:
    return PairDifference(
        scenario=scenario, metric="position_rmse", unit="m", entrant=Entrant(tracker=tracker),
        against=Entrant(tracker="base"), value=1.1, reference=1.0, difference=0.1, ci95=(0.05, 0.15), margin=0.01,
        p_value=0.01, paired_runs=20, scenes=1, verdict="worse", log_ratio=LogRatio(0.095, 0.02, 19),
    )  # fmt: skip


def score(scenario: str, tracker: str, diverged: int) -> EntrantScore:
    entrant = Entrant(tracker=tracker)
    return EntrantScore(scenario=scenario, entrant=entrant, metrics={}, diverged_runs=diverged, leading=True)


def test_nothing_is_pooled_of_a_tracker_that_lacks_a_scenario_and_no_interval_of_one_that_diverged() -> None:
    pairs = [difference(scenario, tracker) for scenario in "ab" for tracker in ("sound", "lost")]
    scores = [score("a", "sound", 0), score("b", "lost", 1)]
    found = {item.entrant.tracker: item for item in overall([*pairs, difference("a", "absent")], ["a", "b"], scores)}
    assert found["sound"].mean_percent == found["lost"].mean_percent == pytest.approx(100 * np.expm1(0.095))
    assert found["sound"].ci95 is not None
    assert found["lost"].ci95 is None
    assert found["absent"].mean_percent is None

"""How a cell is decided, and how the error of a map is spent."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration.bounds import lognormal
from benchmarks.calibration.cells import CELLS, decided, levels_of, looks, planted
from scipy import stats

from trackbench.metrics.bounds import bound, interval_difference
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.subjects.envelope.cells import Spending, changed, decide, joint_state

NUMBERS = (25, 50, 100, 200, 300)


def values_of(mean: float, runs: int = 100, seed: int = 1) -> Interval:
    noise = np.random.default_rng(seed).gamma(4.0, 0.25, runs)
    return root(ratio(mean**2 * noise / noise.mean(), np.ones(runs), at_least=0.0))


def test_the_looks_of_a_cell_spend_its_share_of_the_error_in_proportion_to_the_runs() -> None:
    spending = Spending(0.05, 200, NUMBERS)
    levels = [spending.at(look) for look in range(len(NUMBERS))]
    assert sum(levels) == pytest.approx(0.05 / 200)
    assert np.array(levels) / sum(levels) == pytest.approx(np.array([25, 25, 50, 100, 100]) / 300)


def test_a_cell_holds_where_the_upper_bound_is_below_the_limit_and_fails_where_the_lower_one_is_above() -> None:
    interval = values_of(1.0)
    low, high = bound(interval, 1e-4, "lower"), bound(interval, 1e-4, "upper")
    for limit, below, above in (
        (0.999 * low, "fails", "holds"),
        (1.001 * low, "undecided", "undecided"),
        (0.999 * high, "undecided", "undecided"),
        (1.001 * high, "holds", "fails"),
    ):
        assert decide(interval, limit, "below", 1e-4).state == below
        assert decide(interval, limit, "above", 1e-4).state == above
    assert decide(interval, 1.0, "below", 1e-4)[2:] == (low, high)


def test_to_fail_is_shown_at_the_level_over_the_number_of_requirements_and_to_hold_at_the_whole_level() -> None:
    interval = values_of(1.0)
    for direction, held, failed in (("below", 3, 2), ("above", 2, 3)):
        decision = decide(interval, 1.0, direction, 1e-3, requirements=5)
        side = {3: "upper", 2: "lower"}
        assert decision[held] == bound(interval, 1e-3, side[held])
        assert decision[failed] == bound(interval, 1e-3 / 5, side[failed])


def test_too_few_runs_leave_a_cell_undecided_and_say_why() -> None:
    decision = decide(values_of(1.0, runs=20), 100.0, "below", 0.01)
    assert (decision.state, decision.low, decision.high) == ("undecided", None, None)
    assert decision.reason == "no bound holds with fewer than 25 runs"
    assert not decide(values_of(1.0), 100.0, "below", 0.01).reason


def test_a_cell_holds_with_all_its_requirements_and_fails_with_one() -> None:
    assert joint_state(["holds", "holds"]) == "holds"
    assert joint_state(["holds", "undecided"]) == "undecided"
    assert joint_state(["holds", "undecided", "fails"]) == "fails"
    assert joint_state([]) == "undecided"


@pytest.mark.parametrize("same_runs", [True, False])
def test_a_cell_goes_from_holds_to_fails_where_the_value_is_shown_to_be_worse(same_runs: bool) -> None:
    before, after = values_of(0.7), values_of(1.5, seed=1 if same_runs else 2)
    worse, better = (interval_difference(*pair, same_runs=same_runs) for pair in ((after, before), (before, after)))
    assert changed("holds", "fails", worse, "below", 1e-4)
    assert changed("holds", "fails", better, "above", 1e-4)
    assert not changed("holds", "fails", better, "below", 1e-4)
    assert not changed("holds", "undecided", worse, "below", 1e-4)
    assert not changed("fails", "fails", worse, "below", 1e-4)


def test_the_batched_decision_of_the_calibration_is_that_of_each_cell() -> None:
    random = np.random.default_rng(4)
    values = random.uniform(0.4, 2.0, (60, 1)) * random.gamma(2.0, 0.5, (60, 50))
    batched = decided(values, [50], [1e-4]).state
    words = {1: "holds", -1: "fails", 0: "undecided"}
    single = [decide(root(ratio(own, np.ones(50), at_least=0.0)), 1.0, "below", 1e-4).state for own in values]
    assert [words[state] for state in batched] == single
    assert len(set(single)) == 3


def test_no_map_with_a_planted_requirement_has_a_wrong_cell_and_those_far_from_the_limit_are_decided() -> None:
    random, numbers = np.random.default_rng(5), looks(200)
    wrong, far, changes = 0, [], 0
    for _ in range(20):
        truth = planted(random)
        maps = [
            decided(truth[:, None] * lognormal(0.3)(random, (CELLS, numbers[-1])), numbers, levels_of(numbers))
            for _ in range(2)
        ]
        wrong += bool(np.any(maps[0].state == np.where(truth < 1.0, -1, 1)))
        changes += bool(np.any((maps[0].state == 1) & (maps[1].state == -1)))
        far.append(np.mean(maps[0].state[abs(truth - 1.0) >= 0.1] != 0))
    assert stats.binom.sf(wrong - 1, 20, 0.05) > 0.01
    assert stats.binom.sf(changes - 1, 20, 0.05) > 0.01
    assert np.mean(far) >= 0.95


def test_cells_on_the_limit_are_rarely_decided_although_they_are_looked_at_after_each_doubling() -> None:
    random, numbers = np.random.default_rng(6), looks(400)
    state = decided(lognormal(0.3)(random, (4000, numbers[-1])), numbers, levels_of(numbers, cells=1)).state
    for side in (1, -1):
        assert stats.binom.sf(int((state == side).sum()) - 1, 4000, 0.05) > 1e-3
    # And not so rarely that there is no power.
    assert (state != 0).mean() > 0.01

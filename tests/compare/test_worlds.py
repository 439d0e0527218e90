"""Pairs of trackers over worlds: the order, and the correction for all pairs of all worlds."""

from __future__ import annotations

import pytest
from tests.scenario.test_worlds import SCRIPTED

import trackbench as tb
from trackbench.compare.comparison import OrderInWorlds


@pytest.mark.parametrize(
    ("ahead", "order"),
    [
        ({"ideal": "a", "human": "a"}, "holds"),
        ({"ideal": "b", "human": "b"}, "holds"),
        ({"ideal": "a", "human": "b", "typical": None}, "turns"),
        ({"ideal": "a", "human": None}, "holds in part"),
        ({"ideal": None, "human": None}, "not shown"),
    ],
)
def test_the_order_of_two_trackers(ahead: dict[str, str | None], order: str) -> None:
    assert OrderInWorlds(scenario="s", a="a", b="b", ahead=ahead).order == order


@pytest.fixture(scope="module")
def results() -> list[tb.Result]:
    third = "  mid: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}\nmonte_carlo"
    return tb.run(tb.worlds(SCRIPTED.replace("monte_carlo", third), ["ideal", "typical"]))


def test_the_differences_of_all_worlds_are_corrected_together(results: list[tb.Result]) -> None:
    together = tb.compare(results).differences
    alone = [item for result in results for item in tb.compare(result).differences]
    assert len(together) == len(alone) == 6
    # Of each world's three p-values the least is multiplied by three, and by all six together.
    least = min(together, key=lambda item: item.p_value)
    same = next(item for item in alone if (item.scenario, item.entrant) == (least.scenario, least.entrant))
    assert 0 < least.p_value < 0.5
    assert least.p_value == pytest.approx(2 * min(item.p_value for item in alone if item.scenario == same.scenario))
    assert all(a.p_value >= b.p_value for a, b in zip(together, alone, strict=True))


def test_results_outside_of_worlds_have_no_such_table(results: list[tb.Result]) -> None:
    assert "worlds" not in tb.compare(results[0]).json()

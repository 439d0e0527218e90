"""The cheapest suite of sensors inside an envelope."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims import claim_of

from trackbench.subjects.envelope.suites import cheapest_suites, suite_sentences

#: A coarse radar is cheap, a fast one dear; the speed of the traffic costs nothing.
AXES: dict[str, Any] = {
    "sigma": {"key": "sensors.radar.range_sigma_m", "values": [0.1, 0.5, 1], "cost": {"0.1": 400, "1": 40}},
    "rate": {"key": "sensors.radar.rate_hz", "values": [5, 10, 20], "cost": {"5": 50, "10": 80, "20": 120}},
    "speed": {"key": "truth.observer.start.speed_mps", "values": [10, 30]},
}


def errors(sigma: float, rate: float, speed: float) -> float:
    """In shares of the axes: worse with sigma and speed, better with the rate."""
    return 0.6 + 0.5 * sigma - 0.3 * rate + 0.2 * speed


def test_the_cheapest_suite_holds_at_every_value_of_the_axes_without_a_cost() -> None:
    (found,) = cheapest_suites(claim_of(AXES, {"kf": errors}))
    # sigma 1 (40) fails at 30 m/s with rate 5 and 10, and holds at 10 m/s; with rate 20 it is undecided at .95 to 1.05.
    costs = {
        (s, r): {0.1: 400, 0.5: 240, 1: 40}[s] + {5: 50, 10: 80, 20: 120}[r] for s in (0.1, 0.5, 1) for r in (5, 10, 20)
    }
    held = []
    for (s, r), cost in costs.items():
        shares = (s - 0.1) / 0.9, (r - 5) / 15
        if all(errors(*shares, speed) * 1.05 < 1 for speed in (0, 1)):
            held.append((cost, (s, r)))
    least = min(held)
    assert [suite.values for suite in found.suites] == [least[1]]
    assert found.suites[0].cost == pytest.approx(least[0])
    assert found.cheaper is not None
    assert found.cheaper.cost == max(cost for cost in costs.values() if cost < least[0])
    assert found.cheaper_state != "holds"


def test_suites_of_one_cost_are_tied() -> None:
    axes = {
        name: {"key": f"sensors.{name}.rate_hz", "values": [1, 2], "cost": {"1": 10, "2": 20}} for name in ("a", "b")
    }
    (found,) = cheapest_suites(claim_of(axes, {"kf": lambda a, b: 1.5 - a if a + b < 2 and a == 0 and b == 0 else 0.5}))
    assert [suite.values for suite in found.suites] == [(1, 2), (2, 1)]
    assert found.cheaper is not None
    assert (found.cheaper.values, found.cheaper_state) == ((1, 1), "fails")


def test_all_trackers_together_need_the_dearer_suite() -> None:
    axes = {"rate": AXES["rate"]}
    claim = claim_of(axes, {"good": lambda rate: 0.5, "bad": lambda rate: 1.5 - rate})
    good, bad, every = cheapest_suites(claim)
    assert (good.suites[0].values, good.cheaper) == ((5,), None)
    assert bad.suites == every.suites
    assert bad.suites[0].values == (20,)
    assert len([*suite_sentences(claim)]) == 3


def test_a_refined_suite_that_was_tried_at_few_values_of_the_others_does_not_count() -> None:
    axes = {
        "sigma": {"key": "sensors.radar.range_sigma_m", "from": 0, "to": 1, "levels": 2, "cost": {"0": 100, "1": 0}}
    }
    axes["speed"] = AXES["speed"]
    claim = claim_of(axes, {"kf": lambda sigma, speed: 0.5 + 0.6 * sigma + 0.2 * speed}, more=[(0.5, 0.0)])
    (found,) = cheapest_suites(claim)
    assert found.suites[0].values == (0,)


def test_where_nothing_holds_it_is_said() -> None:
    claim = claim_of({"rate": AXES["rate"]}, {"kf": lambda rate: 2.0})
    assert [*suite_sentences(claim)] == ["kf: holds with no suite, at any cost"]


def test_an_undecided_suite_may_hold() -> None:
    claim = claim_of({"rate": AXES["rate"]}, {"kf": lambda rate: 1.0 if rate > 0.5 else 2.0})
    assert [*suite_sentences(claim)] == ["kf: no suite is shown to hold, 1 undecided"]


def test_without_costs_there_are_no_suites() -> None:
    assert cheapest_suites(claim_of({"speed": AXES["speed"]}, {"kf": lambda speed: 0.5})) == []


@given(st.lists(st.floats(0.5, 1.5), min_size=9, max_size=9))
def test_no_suite_that_costs_less_holds(values: list[float]) -> None:
    axes = {name: AXES[name] for name in ("sigma", "rate")}
    table = dict(zip(product(range(3), range(3)), values, strict=True))
    claim = claim_of(axes, {"kf": lambda sigma, rate: table[round(2 * sigma**0.8), round(2 * rate**0.6)]})
    (found,) = cheapest_suites(claim)
    cost = {
        cell.at: sum(axis.cost(value) for axis, value in zip(claim.axes, cell.at, strict=True)) for cell in claim.cells
    }
    holding = [cost[cell.at] for cell in claim.cells if cell.trackers["kf"].state == "holds"]
    assert {suite.cost for suite in found.suites} == {min(holding)} if holding else not found.suites

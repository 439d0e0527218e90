"""The nearest cell that fails towards each face of a map."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims import claim_of

from trackbench.subjects.envelope.axes import point_distance
from trackbench.subjects.envelope.counter import base_of, nearest_failing

#: Eleven values of each, a tenth of the range apart.
SQUARE: dict[str, Any] = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 0, "to": 10, "levels": 11},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0, "to": 1, "levels": 11},
}


def faces(axes: dict[str, Any], value: Any, **more: Any) -> dict[str, Any]:
    """By face, the point that fails."""
    claim = claim_of(axes, {"ekf": value}, **more)
    return {
        f"{facing.axis} {facing.side}": claim.cells[facing.cell].at
        for facing in nearest_failing(claim, base_of(claim, "ekf"))
    }


def test_the_border_is_met_along_each_axis_from_the_scenario() -> None:
    # Fails with q from 8 on, with r from .9 on and with r up to .1.
    found = faces(SQUARE, lambda q, r: 2.0 if q > 0.75 or abs(r - 0.5) > 0.35 else 0.5, base=[5, 0.5])
    assert found == {"q high": (8, 0.5), "r high": (5, 0.9), "r low": (5, 0.1)}


def test_a_cell_that_fails_for_another_axis_is_no_counter_example_of_this_one() -> None:
    # At q 8 everything fails, also far from r .5: that is not for r.
    assert faces(SQUARE, lambda q, r: 2.0 if q > 0.75 else 0.5, base=[5, 0.5]) == {"q high": (8, 0.5)}


def test_a_failure_that_needs_both_axes_lies_towards_the_face_of_the_further_one() -> None:
    found = faces(SQUARE, lambda q, r: 2.0 if q > 0.65 and r > 0.85 else 0.5, base=[5, 0.5])
    assert found == {"r high": (7, 0.9)}


def test_distances_are_in_the_units_of_scale() -> None:
    value = lambda q, r: 2.0 if q > 0.75 or r > 0.75 else 0.5  # noqa: E731
    claim = claim_of(SQUARE, {"ekf": value}, base=[5, 0.5], scale={"q": 6, "r": 0.1})
    first, second = nearest_failing(claim, base_of(claim, "ekf"))
    assert (first.axis, first.distance) == ("q", pytest.approx(0.5))
    assert (second.axis, second.distance) == ("r", pytest.approx(3))


def test_each_other_choice_is_a_face() -> None:
    axes = {"kind": {"key": "sensors.radar.type", "choices": ["radar", "lidar", "speed_radar"]}, "q": SQUARE["q"]}
    found = faces(axes, lambda kind, q: 2.0 if kind > 0.75 and q > 0.45 else 0.5, base=["radar", 5])
    assert found == {"kind speed_radar": ("speed_radar", 5)}


def test_a_scenario_that_fails_counts_from_the_nearest_cell_that_holds() -> None:
    claim = claim_of(SQUARE, {"ekf": lambda q, r: 2.0 if q > 0.45 else 0.5}, base=[6, 0.5])
    base = base_of(claim, "ekf")
    assert base.at == (4, 0.5)
    assert base.note.startswith("the scenario itself fails")
    assert faces(SQUARE, lambda q, r: 2.0 if q > 0.45 else 0.5, base=[6, 0.5]) == {"q high": (5, 0.5)}


def test_a_scenario_that_is_no_cell_is_not_said_to_fail() -> None:
    base = base_of(claim_of(SQUARE, {"ekf": lambda q, r: 2.0 if q > 0.45 else 0.5}, base=[12, 0.5]), "ekf")
    assert base.note.startswith("the cell nearest to the scenario fails")


def test_where_nothing_holds_the_scenario_stays_the_base() -> None:
    base = base_of(claim_of(SQUARE, {"ekf": lambda q, r: 2.0}, base=[6, 0.5]), "ekf")
    assert (base.at, base.note) == ((6, 0.5), "no cell holds: distances are from the scenario itself")


def test_an_axis_without_a_value_of_the_scenario_takes_its_middle() -> None:
    base = base_of(claim_of(SQUARE, {"ekf": lambda q, r: 0.5}, base=[None, 0.2]), "ekf")
    assert base.at == (5, 0.2)
    assert "no value of q" in base.note


def test_undecided_cells_are_no_counter_examples() -> None:
    assert faces(SQUARE, lambda q, r: 1.0 if q > 0.75 else 0.5, base=[5, 0.5]) == {}


@given(st.sets(st.tuples(st.integers(0, 10), st.integers(0, 10)), max_size=30))
def test_the_nearest_of_all_cells_that_fail_is_always_found(failing: set[tuple[int, int]]) -> None:
    claim = claim_of(
        SQUARE,
        {"ekf": lambda q, r: 2.0 if (round(10 * q), round(10 * r)) in failing - {(5, 5)} else 0.5},
        base=[5, 0.5],
    )
    found = nearest_failing(claim, base_of(claim, "ekf"))
    ways = [
        point_distance(claim.axes, (5, 0.5), cell.at) for cell in claim.cells if cell.trackers["ekf"].state == "fails"
    ]
    assert min((facing.distance for facing in found), default=math.inf) == min(ways, default=math.inf)
    assert all(claim.cells[facing.cell].trackers["ekf"].state == "fails" for facing in found)
    assert len({(facing.axis, facing.side) for facing in found}) == len(found) <= 4

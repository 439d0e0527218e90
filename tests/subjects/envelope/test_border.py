"""The border over two axes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.claims import claim_of

from trackbench.subjects.envelope.border import border_of, slices

SQUARE = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 4, "scale": "log"},
}
shares = st.floats(0.0, 1.0)


def border(value, **more):
    claim = claim_of(SQUARE, {"ekf": value}, **more)
    (part,) = slices(claim, 0, 1)
    return border_of(part, claim, "ekf")


def test_the_border_of_an_exponential_of_a_plane_is_a_straight_line():
    found = border(lambda x, y: math.exp(x + 2 * y - 1.3), more=[(0.3, 0.4), (0.61, 0.37)])
    ends = found.segments.reshape(-1, 2)
    # To the rounding of the values of the axes.
    np.testing.assert_allclose(ends @ [1.0, 2.0], 1.3, atol=1e-4)
    length = np.linalg.norm(np.diff(found.segments, axis=1), axis=-1).sum()
    assert length == pytest.approx(math.hypot(1.0, 0.5), abs=1e-4)


@settings(max_examples=40)
@given(
    st.lists(st.tuples(shares, shares), min_size=3, max_size=12),
    st.lists(st.floats(-1, 1), min_size=4, max_size=4),
    st.floats(0, 0.5),
)
def test_the_border_separates_what_is_decided_and_lies_in_its_band(more, waves, reach):
    a, b, c, d = waves
    found = border(lambda x, y: math.exp(a + b * math.cos(5 * x + c) + d * math.sin(7 * y)), reach=reach, more=more)
    for row in found.triangles:
        states = {found.states[corner] for corner in row}
        crossed = any(_inside(found.places[row], piece.mean(axis=0)) for piece in found.segments)
        if states in ({"holds"}, {"fails"}):
            assert not crossed
        if states == {"holds", "fails"}:
            assert crossed
    for piece in found.segments:
        assert any(_inside(corners, piece.mean(axis=0)) for corners in found.area("undecided"))


def _inside(corners, place) -> bool:
    edges = np.column_stack([corners[1] - corners[0], corners[2] - corners[0]])
    u, v = np.linalg.solve(edges, place - corners[0])
    return min(u, v, 1 - u - v) > -1e-9 and abs(u) + abs(v) < 3


def test_a_cell_that_fails_without_a_value_has_the_border_half_way():
    found = border(lambda x, y: None if x > 0.6 else 0.5)
    np.testing.assert_allclose(found.segments[..., 0], 0.625)


def test_cells_on_a_line_have_no_border():
    claim = claim_of(SQUARE, {"ekf": lambda x, y: 2 * x})
    one = claim.model_copy(update={"cells": [cell for cell in claim.cells if cell.point[0] == 1.0]})
    (part,) = slices(one, 0, 1)
    assert not len(border_of(part, one, "ekf").segments)


def test_slices_are_at_the_levels_of_the_other_axes():
    axes = {**SQUARE, "world": {"key": "truth.world", "choices": ["ideal", "human"]}}
    axes["n"] = {"key": "sensors.radar.rate_hz", "from": 5, "to": 25, "levels": 3}
    claim = claim_of(axes, {"ekf": lambda *_: 0.5})
    parts = slices(claim, 0, 1)
    assert [[value for _, value in part.at] for part in parts] == [
        [world, rate] for world in ("ideal", "human") for rate in (5.0, 15.0, 25.0)
    ]
    assert {len(part.cells) for part in parts} == {20}
    assert all(part.exact for part in parts)


def test_a_sobol_design_is_cut_into_parts():
    axes = {**SQUARE, "n": {"key": "sensors.radar.rate_hz", "from": 5, "to": 20, "levels": 7}}
    claim = claim_of(axes, {"ekf": lambda *_: 0.5}, design="sobol")
    parts = slices(claim, 0, 1)
    assert [part.at[0][1] for part in parts] == [7.5, 12.5, 17.5]
    assert sum(len(part.cells) for part in parts) == len(claim.cells)
    assert not any(part.exact for part in parts)

"""The border of a map with its band: along a line, and over two axes."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.claims import claim_of

from trackbench.subjects.envelope.axes import MapAxis
from trackbench.subjects.envelope.config import Axis
from trackbench.subjects.envelope.margins import (
    AxisMargin,
    Crossing,
    border,
    border_of,
    holding,
    margins,
    place_of_line,
    slices,
)

LINE = {"q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 21}}
SQUARE = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 3, "scale": "log"},
}


def only(axes, value, **more) -> AxisMargin:
    (margin,) = margins(claim_of(axes, {"ekf": value}, **more), "ekf")
    return margin


def test_the_border_of_an_exponential_is_met_exactly():
    """exp(x - 0.43) meets 1 at .43 of the axis, and the logarithm is a straight line."""
    (crossing,) = only(LINE, lambda x: math.exp(x - 0.43), reach=0.06).crossings
    assert crossing.point == pytest.approx(1.0 + 2.0 * 0.43, abs=1e-4)
    assert (crossing.low, crossing.high) == (1.7, 2.0)
    assert crossing.holds_below


def test_the_border_of_a_difference_is_met_exactly():
    """A value that is negative somewhere is interpolated by itself."""
    (crossing,) = only(LINE, lambda x: 1.0 - 3.0 * (x - 0.61), reach=0.02).crossings
    assert crossing.point == pytest.approx(1.0 + 2.0 * 0.61, abs=1e-4)
    assert not crossing.holds_below


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (lambda x: 0.5, "in all 21 cells from 1 to 3 m"),
        (lambda x: 2.0, "in none of its 21 cells from 1 to 3 m"),
        (lambda x: 1.0, "at no value surely"),
        (lambda x: math.exp(x - 0.43), "up to 1.86 ± 0.16 m"),
        (lambda x: math.exp(0.43 - x), "from 1.86 ± 0.16 m on"),
        (lambda x: math.exp(math.cos(2 * math.pi * x)), "from 1.50 ± 0.10 m to 2.50 ± 0.10 m"),
        (lambda x: None if x > 0.5 else 0.5, "up to 2.05 ± 0.05 m"),
    ],
)
def test_it_is_said_where_it_holds(value, says):
    margin = only(LINE, value, reach=0.06)
    assert holding(margin) == says


@given(st.floats(0.1, 1e3), st.floats(1e-3, 1.0), st.floats(0.41, 0.59))
def test_what_is_printed_contains_the_band(low, width, share):
    high = low * (1 + width)
    axis = MapAxis("q", Axis.model_validate({"key": "a.b", "from": 0, "to": 1e4}))
    printed = border(axis, Crossing(low, high, low + share * (high - low), True))
    centre, half = map(float, printed.split(" ± "))
    assert centre - half <= low + 1e-5 * (high - low)
    assert centre + half >= high - 1e-5 * (high - low)


@pytest.mark.parametrize(
    ("low", "point", "high", "text"),
    [
        (2.003, 2.23, 2.381, "2.23 (2.00 to 2.39)"),
        (0.012, 0.1, 1.0, "0.10 (0.01 to 1.00)"),
        (0.0, 2.0, 10.0, "2 (0 to 10)"),
    ],
)
def test_the_ends_of_a_band_have_the_decimals_of_the_border(low, point, high, text):
    axis = MapAxis("q", Axis.model_validate({"key": "a.b", "from": 0, "to": 1e4}))
    assert border(axis, Crossing(low, high, point, True)) == text


def test_the_line_goes_through_the_scenario_or_near_it():
    claim = claim_of(SQUARE, {"ekf": lambda x, y: x + y}, base=[1.4, 1.0], more=[(0.5, 0.25), (0.125, 0.5)])
    along_q, along_r = margins(claim, "ekf")
    assert [value for _, value in along_q.at] == [1.0]
    assert [value for _, value in along_r.at] == [1.5]
    assert (holding(along_r), place_of_line(along_r)) == ("up to 3.7 deg (1.0 to 10.0)", "q 1.5 m")


def test_each_category_has_its_line():
    axes = {**LINE, "world": {"key": "truth.world", "choices": ["ideal", "human"]}}
    claim = claim_of(axes, {"ekf": lambda x, world: math.exp(x - 0.4 - 0.2 * world)})
    found = {margin.at[0][1]: margin.crossings[0].point for margin in margins(claim, "ekf")}
    assert found == {"ideal": pytest.approx(1.8, abs=1e-3), "human": pytest.approx(2.2, abs=1e-3)}


MAP = {
    "q": {"key": "sensors.radar.range_sigma_m", "from": 1.0, "to": 3.0, "levels": 5},
    "r": {"key": "sensors.radar.azimuth_sigma_deg", "from": 0.1, "to": 10.0, "levels": 4, "scale": "log"},
}


def map_border(value, **more):
    claim = claim_of(MAP, {"ekf": value}, **more)
    (part,) = slices(claim, 0, 1)
    return border_of(part, claim, "ekf")


def segments_of(border):
    """The border as a figure draws it: pieces with two ends each, in shares of the axes."""
    _, axes = plt.subplots()
    contour = axes.tricontour(border.mesh, border.beyond, levels=[0.0])
    pieces = [line for lines in contour.get_paths() for line in lines.to_polygons(closed_only=False)]
    plt.close()
    return np.concatenate([np.zeros((0, 2, 2)), *(np.stack([line[:-1], line[1:]], axis=1) for line in pieces)])


def test_the_border_of_an_exponential_of_a_plane_is_a_straight_line():
    found = map_border(lambda x, y: math.exp(x + 2 * y - 1.3), more=[(0.3, 0.4), (0.61, 0.37)])
    segments = segments_of(found)
    # To the rounding of the values of the axes.
    np.testing.assert_allclose(segments.reshape(-1, 2) @ [1.0, 2.0], 1.3, atol=1e-4)
    length = np.linalg.norm(np.diff(segments, axis=1), axis=-1).sum()
    assert length == pytest.approx(math.hypot(1.0, 0.5), abs=1e-4)


def test_a_cell_that_fails_without_a_value_has_the_border_half_way():
    found = map_border(lambda x, y: None if x > 0.6 else 0.5)
    np.testing.assert_allclose(segments_of(found)[..., 0], 0.625)


def test_slices_are_at_the_levels_of_the_other_axes():
    axes = {**MAP, "world": {"key": "truth.world", "choices": ["ideal", "human"]}}
    axes["n"] = {"key": "sensors.radar.rate_hz", "from": 5, "to": 25, "levels": 3}
    claim = claim_of(axes, {"ekf": lambda *_: 0.5})
    parts = slices(claim, 0, 1)
    assert [[value for _, value in part.at] for part in parts] == [
        [world, rate] for world in ("ideal", "human") for rate in (5.0, 15.0, 25.0)
    ]
    assert {len(part.cells) for part in parts} == {20}

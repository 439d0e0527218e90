"""Ratios that are conversions of units, by their definitions."""

from __future__ import annotations

from itertools import pairwise
from math import pi

import pytest

from trackbench.subjects.doctor.units_ratio import SURE, UNITS, conversion


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (180 / pi, "degrees for radians (180/pi = 57.3)"),
        (pi / 180, "radians for degrees (pi/180 = 0.01745)"),
        (3.6, "km/h for m/s (3.6)"),
        (1 / 3.6, "m/s for km/h (1/3.6 = 0.2778)"),
        (3.28084, "feet for metres (3.281)"),
        (3600 / 1609.344, "miles per hour for m/s (2.237)"),
    ],
)
def test_a_ratio_is_said_as_what_it_is(ratio: float, words: str) -> None:
    found = conversion(ratio)
    assert found is not None
    assert found.words == words
    assert found.exact == pytest.approx(ratio, rel=1e-5)


def test_variances_have_squares() -> None:
    found = conversion((180 / pi) ** 2, power=2)
    assert found is not None
    assert found.formula == "(180/pi)^2"
    assert conversion((180 / pi) ** 2) is None


def test_a_thousand_depends_on_what_it_is_of() -> None:
    assert conversion(1000.0) is None
    assert conversion(1000.0, quantities=("time",)).unit.name == "milliseconds"
    assert conversion(1000.0, quantities=("length",)).words == "millimetres for metres (1000)"


def test_no_ratio_is_two_units_within_the_largest_uncertainty() -> None:
    sizes = sorted(
        size for unit in UNITS for size in (unit.size, 1 / unit.size) if unit.quantity in ("speed", "length")
    )
    apart = [b / a for a, b in pairwise(sizes)]
    assert min(apart) > (1 + SURE) ** 2


@pytest.mark.parametrize("ratio", [1.0, 2.0, 57.3 * 1.05, 1.8, 0.0, -3.6, float("nan"), float("inf")])
def test_another_ratio_is_no_unit(ratio: float) -> None:
    assert conversion(ratio) is None


def test_an_uncertain_ratio_is_not_said() -> None:
    assert conversion(3.6, 0.04) is not None
    assert conversion(3.6, 0.06) is None

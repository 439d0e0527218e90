"""Ratios of two units that are confused: 57.3 is degrees for radians."""

from __future__ import annotations

from collections.abc import Sequence
from math import log, pi
from typing import NamedTuple

#: Largest uncertainty with which a ratio is said to be a unit's, relative to it: half the distance between the nearest
#: two, 3.281 and 3.6.
SURE = 0.045
#: Least uncertainty of a ratio, of finite differences and rounding.
LEAST = 0.01
#: The same among angles and times, whose units are far apart.
FAR_APART = 0.3


class UnitConversion(NamedTuple):
    """A unit that is taken for the SI's."""

    size: float
    """How many of it are one of the SI's."""
    name: str
    si: str
    quantity: str
    """angle, time, speed or length."""


UNITS = (
    UnitConversion(180 / pi, "degrees", "radians", "angle"),
    UnitConversion(1e3, "milliseconds", "seconds", "time"),
    UnitConversion(1e6, "microseconds", "seconds", "time"),
    UnitConversion(1e9, "nanoseconds", "seconds", "time"),
    UnitConversion(3.6, "km/h", "m/s", "speed"),
    UnitConversion(3600 / 1609.344, "miles per hour", "m/s", "speed"),
    UnitConversion(1 / 0.3048, "feet", "metres", "length"),
    UnitConversion(1e3, "millimetres", "metres", "length"),
    UnitConversion(1 / 1609.344, "miles", "metres", "length"),
)


class Conversion(NamedTuple):
    """A unit that explains a ratio."""

    unit: UnitConversion
    exact: float
    """The ratio that it explains: ``size ** power``, or its inverse."""
    formula: str

    @property
    def words(self) -> str:
        """To follow a ratio in a sentence."""
        first, second = (self.unit.name, self.unit.si)
        if (self.exact > 1.0) != (self.unit.size > 1.0):
            first, second = second, first
        exact = "" if self.formula == f"{self.exact:.4g}" else f" = {self.exact:.4g}"
        return f"{first} for {second} ({self.formula}{exact})"


def conversion(
    ratio: float,
    uncertainty: float = 0.0,
    *,
    power: int = 1,
    quantities: Sequence[str] = ("angle", "time", "speed", "length"),
) -> Conversion | None:
    """The confusion of units that a ratio is, if there is exactly one.

    Args:
        ratio: the value found over the right one.
        uncertainty: of the ratio, relative to it.
        power: 2 for a ratio of variances.
        quantities: those that are possible.
    """
    tolerance = max(uncertainty, LEAST)
    sure = SURE if {"speed", "length"} & set(quantities) else FAR_APART
    if not ratio > 0.0 or tolerance > sure * power:
        return None
    conversions = [
        Conversion(unit, unit.size**exponent, formula(unit.size, exponent))
        for unit in UNITS
        if unit.quantity in quantities
        for exponent in (power, -power)
        if abs(log(ratio) - exponent * log(unit.size)) < tolerance
    ]
    return conversions[0] if len(conversions) == 1 else None


def formula(size: float, exponent: int) -> str:
    """A power of a unit's size in words."""
    base = "180/pi" if abs(size - 180 / pi) < 1e-9 else f"{size:.4g}"
    if exponent < 0:
        base = "pi/180" if base == "180/pi" else f"1/{base}"
    return base if abs(exponent) == 1 else f"({base})^{abs(exponent)}"

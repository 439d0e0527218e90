"""Units at the end of key names, and conversion between units of one quantity."""

from __future__ import annotations

import math
from typing import NamedTuple


class Unit(NamedTuple):
    """Unit of a physical quantity, with its size in SI units and its spellings."""

    quantity: str
    """Name of the measured quantity, such as "length"; only units of one quantity convert into each other."""
    factor: float
    """Size of the unit in SI units; of an angle in rad."""
    words: str
    """Spelling within a sentence, such as "metres"."""
    symbol: str
    """Spelling after a number, such as "m"."""


UNITS = {
    "m": Unit("length", 1, "metres", "m"),
    "cm": Unit("length", 0.01, "centimetres", "cm"),
    "mm": Unit("length", 0.001, "millimetres", "mm"),
    "km": Unit("length", 1000, "kilometres", "km"),
    "rad": Unit("angle", 1, "radians", "rad"),
    "mrad": Unit("angle", 0.001, "milliradians", "mrad"),
    "deg": Unit("angle", math.pi / 180, "degrees", "deg"),
    "s": Unit("time", 1, "seconds", "s"),
    "ms": Unit("time", 0.001, "milliseconds", "ms"),
    "us": Unit("time", 1e-6, "microseconds", "us"),
    "min": Unit("time", 60, "minutes", "min"),
    "hz": Unit("rate", 1, "Hz", "Hz"),
    "mps": Unit("speed", 1, "m/s", "m/s"),
    "kmh": Unit("speed", 1 / 3.6, "km/h", "km/h"),
    "mph": Unit("speed", 0.44704, "miles per hour", "mph"),
    "mps2": Unit("acceleration", 1, "m/s^2", "m/s^2"),
    "g": Unit("acceleration", 9.80665, "g", "g"),
    "mps3": Unit("jerk", 1, "m/s^3", "m/s^3"),
    "mps1p5": Unit("acceleration density", 1, "m/s^1.5", "m/s^1.5"),
    "mps2p5": Unit("jerk density", 1, "m/s^2.5", "m/s^2.5"),
    "radps": Unit("turn rate", 1, "rad/s", "rad/s"),
    "degps": Unit("turn rate", math.pi / 180, "degrees per second", "deg/s"),
    "radps2": Unit("turn acceleration", 1, "rad/s^2", "rad/s^2"),
    "degps2": Unit("turn acceleration", math.pi / 180, "degrees per second squared", "deg/s^2"),
}

#: Other spellings of units, in keys and after numbers.
SPELLINGS = {
    "°": "deg",
    "kph": "kmh",
    "kmph": "kmh",
    "km/h": "kmh",
    "m/s": "mps",
    "m/s^2": "mps2",
    "m/s2": "mps2",
    "m/s^3": "mps3",
    "m/s3": "mps3",
    "m/s^1.5": "mps1p5",
    "m/s^2.5": "mps2p5",
    "rad/s": "radps",
    "deg/s": "degps",
    "°/s": "degps",
    "rad/s^2": "radps2",
    "rad/s2": "radps2",
}


def find_unit(name: str) -> Unit | None:
    """Return the unit with this name or spelling, in any case; None for an unknown one."""
    low = name.lower()
    return UNITS.get(SPELLINGS.get(low, low))


def split_key(key: str) -> tuple[str, Unit | None]:
    """Split a key into its stem and its unit: ``range_sigma_m`` gives ``range_sigma`` and m; None for no unit."""
    stem, _, last = key.rpartition("_")
    unit = find_unit(last) if stem else None
    return (stem, unit) if unit else (key, None)


def in_si(key: str, value: float) -> float:
    """Convert the value of a key whose name ends in a unit, such as ``range_sigma_m``, to SI units and radians."""
    unit = split_key(key)[1]
    assert unit is not None
    return value * unit.factor


def convert(value: float, source: Unit, target: Unit) -> float | None:
    """Convert ``value`` from the unit ``source`` to ``target``; None where they measure different quantities."""
    return value * source.factor / target.factor if source.quantity == target.quantity else None


def show(value: float) -> str:
    """Format a number as in a scenario file; a fraction is rounded to four significant digits."""
    return f"{value:.4g}" if abs(value) < 1e4 and value != round(value) else f"{value:.10g}"


def option_in_words(key: str, value: object) -> str:
    """Return an option's key and value in words, such as "acceleration sigma 3 m/s^2"."""
    stem, unit = split_key(key)
    shown = f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
    return " ".join([stem.replace("_", " "), shown, *([unit.symbol] if unit else [])])

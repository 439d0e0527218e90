"""Axes of an envelope map: their starting values, distances between values, and the scenario keys that a value sets."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from trackbench.base.config.key_units import split_key
from trackbench.subjects.envelope.config import Axis, EnvelopeConfig, Linked

#: Value of an axis: a number, or the name of a choice.
Value = float | str
#: Point of a map: a value of each axis, in the order of the axes.
Point = tuple[Value, ...]


@dataclass(frozen=True)
class MapAxis:
    """Axis of an envelope map, such as a sensor's range noise: its name, its values, and distances between values."""

    name: str
    config: Axis

    @property
    def continuous(self) -> bool:
        """Whether cells can be added between two starting values of the axis."""
        return self.config.continuous

    @property
    def ordered(self) -> bool:
        """Whether the values of the axis are numbers; False for named choices."""
        return self.config.form != "choices"

    @property
    def unit(self) -> str:
        """Unit symbol of the values; empty where there is none."""
        if self.config.unit or self.config.key is None:
            return self.config.unit
        unit = split_key(self.config.key.rpartition(".")[2])[1]
        return unit.symbol if unit else ""

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """Values of the axis at which the first cells of the map lie, before cells are added between them."""
        config = self.config
        if config.form == "choices":
            return tuple(str(choice) for choice in config.choices)
        if not config.continuous:
            return tuple(sorted(config.values))
        return tuple(map(self.at, np.linspace(0.0, 1.0, config.levels).tolist()))

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value of a numeric axis."""
        if self.continuous:
            return float(self.config.low or 0.0), float(self.config.high or 0.0)
        numbers = [float(value) for value in self.values]
        return numbers[0], numbers[-1]

    @property
    def links(self) -> Mapping[str, Linked]:
        """Scenario keys that a numeric axis sets, each with the factor and offset of the axis value."""
        if self.config.key is not None:
            return {self.config.key: Linked()}
        return {key: link for key, link in self.config.keys.items() if link.factor}

    def nearest(self, value: Value | None) -> Value:
        """Return the nearest value between the ends of the axis; a choice as it is; the middle of the axis for None."""
        if value is None:
            return self.values[len(self.values) // 2]
        return value if isinstance(value, str) else min(max(value, self.ends[0]), self.ends[1])

    def takes(self, value: Value) -> bool:
        """Return whether a value of the axis is valid as the coordinate of a cell."""
        return self.reaches(value) if self.continuous else value in self.values

    def reaches(self, value: Value | None) -> bool:
        """Return whether a value is a number between the ends of the axis."""
        return isinstance(value, float | int) and self.ends[0] <= value <= self.ends[1]

    def exactly_at(self, share: Any) -> Any:
        """Return the unrounded values of a numeric axis at positions along it, 0 to 1, a number or an array."""
        low, high = self.ends
        return low * (high / low) ** share if self.config.scale == "log" else low + share * (high - low)

    def at(self, share: float) -> float:
        """Return the value of a numeric axis at a position along it, 0 to 1, rounded to about six digits."""
        value, (low, high) = float(self.exactly_at(share)), self.ends
        digits = 5 - math.floor(math.log10(high - low if self.config.scale == "linear" else value))
        return round(value, digits)

    def share(self, value: Value) -> float:
        """Return the position of a value between the ends of the axis, 0 to 1; choices are equally spaced."""
        if not self.ordered or isinstance(value, str):
            return self.values.index(value) / max(1, len(self.values) - 1)
        low, high = self.ends
        if self.config.scale == "log":
            return math.log(value / low) / math.log(high / low)
        return (value - low) / (high - low)

    def distance(self, a: Value, b: Value) -> float:
        """Return the distance between two numbers as a share of the axis, 0 to 1; for choices 0 if equal, else 1."""
        return float(a != b) if isinstance(a, str) else abs(self.share(a) - self.share(b))

    def changes(self, value: Value) -> dict[str, Any]:
        """Return the scenario's keys that a value of the axis sets, with their settings."""
        config = self.config
        if isinstance(config.choices, dict) and config.choices:
            return dict(config.choices[str(value)])
        if config.form == "choices":
            assert config.key is not None
            return {config.key: next(choice for choice in config.choices if str(choice) == value)}
        number = float(value)
        links = config.keys or {str(config.key): Linked()}
        return {key: _int_if_whole(link.offset + link.factor * number) for key, link in links.items()}

    def shown(self, value: Value) -> str:
        """Return a value of the axis with its unit as text: "0.5 deg"."""
        return value if isinstance(value, str) else f"{value:.4g} {self.unit}".strip()


def axes_of(config: EnvelopeConfig) -> tuple[MapAxis, ...]:
    """Return the axes of a map, in the order of the scenario."""
    return tuple(MapAxis(name, axis) for name, axis in config.axes.items())


def overrides(axes: Sequence[MapAxis], point: Point) -> list[str]:
    """Return the changes of the scenario at a point (a value for each axis), as ``key.path=value``."""
    changed: dict[str, Any] = {}
    for axis, value in zip(axes, point, strict=True):
        changed |= axis.changes(value)
    return [f"{key}={json.dumps(value)}" for key, value in changed.items()]


def start_points(axes: Sequence[MapAxis], config: EnvelopeConfig, base: Sequence[Value | None]) -> list[Point]:
    """Return the points of the first cells of a map, at most ``config.cells``.

    They are every combination of the axes' starting values, and the scenario's own point ``base`` if the map covers it.
    """
    points = list(product(*(axis.values for axis in axes)))
    inside = [value for axis, value in zip(axes, base, strict=True) if value is not None and axis.takes(value)]
    points += [tuple(inside)] if len(inside) == len(axes) else []
    return list(dict.fromkeys(points))[: config.cells]


def point_distance(axes: Sequence[MapAxis], a: Point, b: Point) -> float:
    """Return the Euclidean distance between two points, with each axis scaled to the range 0 to 1."""
    return math.hypot(*(axis.distance(x, y) for axis, x, y in zip(axes, a, b, strict=True)))


def halfway_point(axes: Sequence[MapAxis], a: Point, b: Point, resolution: float) -> Point | None:
    """Return the point half way between points; None if they are within ``resolution``, or no value lies between."""
    middle: list[Value] = []
    for axis, x, y in zip(axes, a, b, strict=True):
        if x == y:
            middle.append(x)
        elif not axis.continuous or isinstance(x, str) or isinstance(y, str):
            return None
        else:
            middle.append(axis.at((axis.share(x) + axis.share(y)) / 2))
    distance = max(abs(axis.share(x) - axis.share(y)) for axis, x, y in zip(axes, a, b, strict=True))
    point = tuple(middle)
    return None if distance <= resolution * (1 + 1e-9) or point in (a, b) else point


def _int_if_whole(number: float) -> float | int:
    # Some keys accept integers only.
    return int(number) if number == int(number) and abs(number) < 1e15 else round(number, 12)

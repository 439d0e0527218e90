"""Points of the map: where they lie on each axis, and what they change in the scenario."""

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

#: A value of an axis: a number, or the name of a choice.
Value = float | str
#: A value of each axis, in the order of the axes.
Point = tuple[Value, ...]


@dataclass(frozen=True)
class MapAxis:
    """An axis by its name, with its geometry."""

    name: str
    config: Axis

    @property
    def continuous(self) -> bool:
        """Whether the map may be refined along it."""
        return self.config.continuous

    @property
    def ordered(self) -> bool:
        """Whether its values are numbers."""
        return self.config.form != "choices"

    @property
    def unit(self) -> str:
        """Of its values; empty where there is none."""
        if self.config.unit or self.config.key is None:
            return self.config.unit
        unit = split_key(self.config.key.rpartition(".")[2])[1]
        return unit.symbol if unit else ""

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """Those that the map starts from."""
        config = self.config
        if config.form == "choices":
            return tuple(str(choice) for choice in config.choices)
        if not config.continuous:
            return tuple(sorted(config.values))
        return tuple(map(self.at, np.linspace(0.0, 1.0, config.levels).tolist()))

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The least and the largest value of an axis of numbers."""
        if self.continuous:
            return float(self.config.low or 0.0), float(self.config.high or 0.0)
        numbers = [float(value) for value in self.values]
        return numbers[0], numbers[-1]

    @property
    def links(self) -> Mapping[str, Linked]:
        """How keys of the scenario follow the value of an axis of numbers; without those that it does not change."""
        if self.config.key is not None:
            return {self.config.key: Linked()}
        return {key: link for key, link in self.config.keys.items() if link.factor}

    def nearest(self, value: Value | None) -> Value:
        """Return the value within the ends that is nearest to a value; for None the middle of the axis."""
        if value is None:
            return self.values[len(self.values) // 2]
        return value if isinstance(value, str) else min(max(value, self.ends[0]), self.ends[1])

    def takes(self, value: Value) -> bool:
        """Whether it may have a value."""
        return self.reaches(value) if self.continuous else value in self.values

    def reaches(self, value: Value | None) -> bool:
        """Whether a number lies between the ends."""
        return isinstance(value, float | int) and self.ends[0] <= value <= self.ends[1]

    def exactly_at(self, share: Any) -> Any:
        """The values at shares of an axis of numbers."""
        low, high = self.ends
        return low * (high / low) ** share if self.config.scale == "log" else low + share * (high - low)

    def at(self, share: float) -> float:
        """The value at a share of an axis of numbers, rounded to what a person would write."""
        value, (low, high) = float(self.exactly_at(share)), self.ends
        digits = 5 - math.floor(math.log10(high - low if self.config.scale == "linear" else value))
        return round(value, digits)

    def share(self, value: Value) -> float:
        """Where a value lies between the ends, from 0 to 1; a choice by its place."""
        if not self.ordered or isinstance(value, str):
            return self.values.index(value) / max(1, len(self.values) - 1)
        low, high = self.ends
        if self.config.scale == "log":
            return math.log(value / low) / math.log(high / low)
        return (value - low) / (high - low)

    def distance(self, a: Value, b: Value) -> float:
        """Return the distance of two values in shares of the range; of choices 0 or 1."""
        return float(a != b) if isinstance(a, str) else abs(self.share(a) - self.share(b))

    def changes(self, value: Value) -> dict[str, Any]:
        """By key of the scenario, what it is set to."""
        config = self.config
        if isinstance(config.choices, dict) and config.choices:
            return dict(config.choices[str(value)])
        if config.form == "choices":
            assert config.key is not None
            return {config.key: next(choice for choice in config.choices if str(choice) == value)}
        number = float(value)
        links = config.keys or {str(config.key): Linked()}
        return {key: _plain(link.offset + link.factor * number) for key, link in links.items()}

    def shown(self, value: Value) -> str:
        """A value with its unit, as it is read."""
        return value if isinstance(value, str) else f"{value:.4g} {self.unit}".strip()


def axes_of(config: EnvelopeConfig) -> tuple[MapAxis, ...]:
    """The axes of a map, in the order of the scenario."""
    return tuple(MapAxis(name, axis) for name, axis in config.axes.items())


def overrides(axes: Sequence[MapAxis], point: Point) -> list[str]:
    """What a point changes in the scenario: ``key.path=value`` each."""
    changed: dict[str, Any] = {}
    for axis, value in zip(axes, point, strict=True):
        changed |= axis.changes(value)
    return [f"{key}={json.dumps(value)}" for key, value in changed.items()]


def start_points(axes: Sequence[MapAxis], config: EnvelopeConfig, own: Sequence[Value | None]) -> list[Point]:
    """Where the map starts: at most so many points as it may have cells.

    They are every combination of the levels, and the scenario's own point, where it has a value of each axis that the
    axis takes.

    Args:
        axes: of the map.
        config: the block.
        own: by axis the scenario's own value; None where it has none.
    """
    points = list(product(*(axis.values for axis in axes)))
    inside = [value for axis, value in zip(axes, own, strict=True) if value is not None and axis.takes(value)]
    points += [tuple(inside)] if len(inside) == len(axes) else []
    return list(dict.fromkeys(points))[: config.cells]


def point_distance(axes: Sequence[MapAxis], a: Point, b: Point) -> float:
    """Return the Euclidean distance of two points, in shares of each range."""
    return math.hypot(*(axis.distance(x, y) for axis, x, y in zip(axes, a, b, strict=True)))


def between(axes: Sequence[MapAxis], a: Point, b: Point, resolution: float) -> Point | None:
    """The point half way between two that differ in continuous axes alone; None where nothing is left between them."""
    middle: list[Value] = []
    for axis, x, y in zip(axes, a, b, strict=True):
        if x == y:
            middle.append(x)
        elif not axis.continuous or isinstance(x, str) or isinstance(y, str):
            return None
        else:
            middle.append(axis.at((axis.share(x) + axis.share(y)) / 2))
    apart = max(abs(axis.share(x) - axis.share(y)) for axis, x, y in zip(axes, a, b, strict=True))
    point = tuple(middle)
    return None if apart <= resolution * (1 + 1e-9) or point in (a, b) else point


def _plain(number: float) -> float | int:
    """Whole numbers as such: some keys take no others."""
    return int(number) if number == int(number) and abs(number) < 1e15 else round(number, 12)

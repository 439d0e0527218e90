"""What is tuned of a tracker: options, each with the range in which its best value is looked for."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Scale = Literal["log", "linear", "odds", "integer", "choice"]
#: Significant digits of a value: more than any tuning can tell, and few enough to be read.
DIGITS = 4
#: A value so near to an end of its range, as a share of the range on its scale, is at the edge.
EDGE = 0.02

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Parameter:
    """An option of a tracker and the values that are tried."""

    key: str
    """As ``sweep:`` writes it: ``initial.velocity_sigma_mps``."""
    scale: Scale
    low: float = 0.0
    high: float = 1.0
    choices: tuple[Any, ...] = ()
    bounds: tuple[bool, bool] = (False, False)
    """Whether the option takes no smaller values than the low end, and no larger ones than the high end."""

    @property
    def continuous(self) -> bool:
        """Whether values lie between any two."""
        return self.scale in ("log", "linear", "odds")

    def from_unit(self, share: float) -> float:
        """The value at a share of the range, on the scale; of a continuous one."""
        low, high = self._stretch(self.low), self._stretch(self.high)
        value = self._unstretch(low + min(max(share, 0.0), 1.0) * (high - low))
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high) if self.scale != "odds" else _odds(value)

    def to_unit(self, value: float) -> float:
        """The share of the range at which a value lies, on the scale."""
        low, high = self._stretch(self.low), self._stretch(self.high)
        return (self._stretch(value) - low) / (high - low)

    def edge(self, value: Any) -> float | None:
        """The end of the range that a value is at, if it is and the range could be wider there."""
        if self.scale == "choice":
            return None
        near = 0.0 if self.scale == "integer" else EDGE
        share = self.to_unit(value)
        if share <= near and not self.bounds[0]:
            return self.low
        return self.high if share >= 1.0 - near and not self.bounds[1] else None

    def holds(self, value: Any) -> bool:
        """Whether a value is one of those that are tried."""
        if self.scale == "choice":
            return value in self.choices
        return isinstance(value, int | float) and self.low <= value <= self.high

    def as_tried(self, value: Any) -> Any:
        """A value that it holds, of the type of those that are tried: 2 of a scenario may be 2.0 of its tracker."""
        if self.scale == "choice":
            return self.choices[self.choices.index(value)]
        return float(value) if self.continuous else value

    def as_json(self) -> dict[str, Any]:
        """What tells it from others."""
        if self.scale == "choice":
            return {"key": self.key, "choices": list(self.choices)}
        return {"key": self.key, "low": self.low, "high": self.high, "scale": self.scale}

    def __str__(self) -> str:
        if self.scale == "choice":
            return f"{self.key}={','.join(json.dumps(choice) for choice in self.choices)}"
        return f"{self.key}={self.low:g}:{self.high:g}"

    def _stretch(self, value: float) -> float:
        if self.scale == "log":
            return math.log(value)
        return math.log(value / (1.0 - value)) if self.scale == "odds" else value

    def _unstretch(self, stretched: float) -> float:
        if self.scale == "log":
            return math.exp(stretched)
        return 1.0 / (1.0 + math.exp(-stretched)) if self.scale == "odds" else stretched


def _odds(value: float) -> float:
    """A probability with as many digits of its distance from one as of itself."""
    return float(f"{value:.{DIGITS}g}") if value < 0.5 else round(1.0 - float(f"{1.0 - value:.{DIGITS}g}"), 12)


def shown(value: Any) -> str:
    """A value as a scenario writes it."""
    return f"{value:.10g}" if isinstance(value, float) else json.dumps(value)


def settings(values: Values) -> str:
    """Values on one line: ``gate=0.999, confirm=[3, 5]``."""
    return ", ".join(f"{key}={shown(value)}" for key, value in values.items())


def at_edges(parameters: Sequence[Parameter], values: Values) -> list[tuple[Parameter, float]]:
    """The parameters whose value is at an end of its range that could be wider."""
    found = [(item, item.edge(values[item.key])) for item in parameters]
    return [(item, edge) for item, edge in found if edge is not None]

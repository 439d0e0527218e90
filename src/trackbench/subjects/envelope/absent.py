"""Points of the axes at which there is no cell, since a world sets what an axis varies: it would copy another cell."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.results.metric_value import ResultModel
from trackbench.subjects.envelope.axes import MapAxis, Point, Value


class AbsentCells(ResultModel):
    """All points with some values of the axes, at which a cell would be a copy of another."""

    at: dict[str, float | str]
    """By axis, the values that such points have."""
    reason: str

    @property
    def text(self) -> str:
        """What is shown in place of a state: "none (recorded at 10 Hz)"."""
        return f"none ({self.reason})"

    def shown(self, axes: Sequence[MapAxis]) -> str:
        """The values as they are read: "world recorded, rate 20 Hz"."""
        return ", ".join(f"{axis.name} {axis.shown(self.at[axis.name])}" for axis in axes if axis.name in self.at)


def why_absent(absent: Sequence[AbsentCells], axes: Sequence[MapAxis], point: Point) -> str:
    """Return what is shown at a point in place of a state; empty where there may be a cell."""
    values = {axis.name: value for axis, value in zip(axes, point, strict=True)}
    return next((item.text for item in absent if item.at.items() <= values.items()), "")


def absent_along(absent: Sequence[AbsentCells], axes: Sequence[MapAxis], number: int, point: Point) -> dict[Value, str]:
    """Return why there is no cell, by value of one axis, along its line through a point."""
    values = {item.at[axes[number].name] for item in absent if axes[number].name in item.at}
    line = {value: (*point[:number], value, *point[number + 1 :]) for value in values}
    return {value: why for value, at in line.items() if (why := why_absent(absent, axes, at))}

"""What all figures of a report share: how a tracker looks, the legend, axes that fit what is drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from trackbench.palette import TRACKER_COLOURS, tracker_colours
from trackbench.types import Array

Summary = Mapping[str, Any]

#: Values that differ by more than this factor are drawn on a logarithmic axis.
LOG_ABOVE = 15.0

_DASHES = ("solid", (0, (6, 1.5, 1.5, 1.5)), (0, (1.5, 1.5)))


@dataclass(frozen=True)
class Look:
    """How a tracker is drawn, the same in every figure."""

    key: str
    """Class of all that is drawn of it."""
    name: str
    colour: str
    style: Any
    """A matplotlib line style; colours repeat with another one."""


@dataclass(frozen=True)
class Entry:
    """A line of a legend."""

    label: str
    colour: str
    """A CSS colour."""
    mark: Literal["line", "dash", "band", "dot", "ring"] = "line"
    key: str = ""
    """The tracker's class, where the entry is one."""


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    name: str
    title: str
    caption: str
    alternative: str
    svg: str
    legend: tuple[Entry, ...]
    wide: bool = False
    """Whether it is too wide for a phone, which is then to scroll it."""


def looks(summary: Summary) -> dict[str, Look]:
    """Every tracker's look, by name, from its place in the scenario."""
    return look_of([tracker["name"] for tracker in summary["trackers"]])


def look_of(names: Sequence[str]) -> dict[str, Look]:
    """The look of each tracker, by its place."""
    colours = tracker_colours(names)
    return {
        name: Look(f"t{i}", name, colours[name], _DASHES[i // len(TRACKER_COLOURS) % len(_DASHES)])
        for i, name in enumerate(names)
    }


def titles(shown: Iterable[Look]) -> dict[str, str]:
    """The tooltip of each tracker's lines."""
    return {look.key: look.name for look in shown}


def entries(shown: Iterable[Look]) -> tuple[Entry, ...]:
    """Legend lines for trackers."""
    return tuple(Entry(look.name, look.colour, "line" if look.style == "solid" else "dash", look.key) for look in shown)


def fit_value_axis(axes: Axes, drawn: Sequence[Array]) -> bool:
    """Limits that show all of ``drawn`` and no more, logarithmic where it spans orders of magnitude.

    Returns:
        Whether the axis is logarithmic.
    """
    values = np.concatenate([np.ravel(values) for values in drawn]) if drawn else np.empty(0)
    values = values[np.isfinite(values)]
    positive = values[values > 0]
    if not positive.size:
        return False
    if positive.max() < LOG_ABOVE * np.quantile(positive, 0.1):
        axes.set_ylim(0, 1.06 * float(positive.max()))
        return False
    # What is exceptionally small, such as an error at a crossing of zero, must not take up the axis.
    logarithmic(axes, "y")
    axes.set_ylim(0.8 * float(np.quantile(positive, 0.005)), 1.25 * float(positive.max()))
    return True


def logarithmic(axes: Axes, which: Literal["x", "y"]) -> None:
    """A logarithmic axis with plain numbers at 1, 2 and 5."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_tick_params(which="minor", size=0)

"""Axes that fit what is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from trackbench.base.types import Array
from trackbench.document.drawing import GRID
from trackbench.document.margins import shortened

#: Values that differ by more than this factor are drawn on a logarithmic axis.
LOG_ABOVE = 15.0
TIME_LABEL = "time, s"


def time_axis(axes: Axes, end: float) -> None:
    """From 0 to ``end`` s, with round numbers."""
    axes.set_xlim(0, end)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.grid(axis="x", color=GRID, linewidth=0.6)


def panel_title(axes: Axes, name: str, width: float) -> None:
    """What a panel, which is ``width`` points wide with its numbers, shows."""
    # A given height, or matplotlib looks for what it might lie on.
    axes.set_title(shortened(name, width - 30, 10), fontsize=10, loc="left", pad=2, y=1.0)


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
    axis.set_minor_locator(NullLocator())

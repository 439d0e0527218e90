"""Who takes part in a ranking, and who is a reference beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.compare import Comparison
from trackbench.compare.comparison import RankedTracker
from trackbench.document import Figure
from trackbench.document.drawing import INK, MUTED
from trackbench.report.numbers import fixed
from trackbench.report.run.pairs import groups_of


def competitors(comparison: Comparison) -> list[RankedTracker]:
    """The ranked trackers, best first."""
    return [item for item in comparison.ranking if not item.reference]


def label(item: RankedTracker) -> str:
    """Its name, and whether it is a reference."""
    return f"{item.tracker} (reference)" if item.reference else item.tracker


_WIDTH = 760.0
#: Points of a line of text, of a bar, and above the axis.
_LINE, _BAR, _TOP = 22.0, 12.0, 34.0
#: Points of a letter, and of what else stands beside the axis.
_LETTER, _BESIDE = 6.6, 72.0


class _Axis(NamedTuple):
    """Where ranks are, in points of the figure."""

    ranks: int
    side: float
    """What names take on the left and on the right."""

    def x(self, rank: float) -> float:
        return self.side + (_WIDTH - 2 * self.side) * (rank - 1) / max(1, self.ranks - 1)


def rank_figure(comparison: Comparison, colours: Mapping[str, str]) -> Figure:
    """Mean ranks on a line; bars join trackers whose mean ranks are not shown to differ.

    Source: Demsar (2006), "Statistical comparisons of classifiers over multiple data sets", section 3.2.4.
    """
    ranking = comparison.ranking
    bars = _bars(comparison)
    axis = _Axis(len(ranking), min(0.4 * _WIDTH, _BESIDE + _LETTER * max(len(label(item)) for item in ranking)))
    half = -(-len(ranking) // 2)
    below = 10 + _BAR * len(bars)
    height = _TOP + below + _LINE * half + 6

    def paint(canvas: Canvas) -> None:
        # All in points of the figure, downwards.
        axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0, _WIDTH), ylim=(height, 0))
        axes.set_axis_off()
        _paint_axis(axes, axis)
        for number, members in enumerate(bars):
            x, y = [axis.x(item.mean_rank) for item in members], _TOP + 12 + _BAR * number
            axes.plot([min(x), max(x)], [y, y], color=INK, linewidth=3.5)
            axes.plot(x, [y] * len(x), color=INK, linestyle="none", marker="o", markersize=7)
        for place, item in enumerate(ranking):
            left = place < half
            y = _TOP + below + _LINE * (0.5 + (place if left else len(ranking) - 1 - place))
            _paint_tracker(axes, axis, item, y, colours[item.tracker], left=left)

    means = ", ".join(f"{label(item)} {fixed(item.mean_rank, 2)}" for item in ranking)
    joined = "; ".join(" and ".join(item.tracker for item in members) for members in bars)
    return Figure(
        name="ranks",
        title="Mean ranks",
        caption="Mean rank over the scenarios. A bar joins trackers whose mean ranks are not shown to differ; those "
        "that no bar joins are (critical-difference diagram).",
        alternative=f"Mean rank of each tracker: {means}. Not shown to differ: {joined or 'none'}",
        paint=paint,
        height=height,
        width=_WIDTH,
    )


def _bars(comparison: Comparison) -> list[list[RankedTracker]]:
    """The groups of two or more that are not shown to differ."""
    shown = {frozenset((item.a, item.b)) for item in comparison.rank_differences if item.shown}
    names = [item.tracker for item in competitors(comparison)]
    groups = groups_of(names, lambda a, b: frozenset((a, b)) in shown)
    return [[item for item in comparison.ranking if item.tracker in group] for group in groups if len(group) > 1]


def _paint_axis(axes: Axes, axis: _Axis) -> None:
    axes.plot([axis.x(1), axis.x(axis.ranks)], [_TOP, _TOP], color=MUTED, linewidth=1.2)
    step = max(1, round(axis.ranks / 10))
    for rank in np.arange(1, axis.ranks + 0.25, 0.5 * step):
        x, whole = axis.x(float(rank)), float(rank).is_integer()
        axes.plot([x, x], [_TOP, _TOP - (7 if whole else 4)], color=MUTED, linewidth=1.2)
        if whole:
            axes.text(x, _TOP - 11, f"{rank:g}", ha="center", va="bottom", color=INK)
    axes.text(axis.side - 30, _TOP - 11, "mean rank", ha="right", va="bottom", color=MUTED)


def _paint_tracker(axes: Axes, axis: _Axis, item: RankedTracker, y: float, colour: str, *, left: bool) -> None:
    """From its place on the axis down to its name at the side."""
    x, outwards = axis.x(item.mean_rank), -1 if left else 1
    end = (axis.side if left else _WIDTH - axis.side) + 20 * outwards
    axes.plot([x, x, end], [_TOP, y, y], color=colour, linewidth=1.6, solid_joinstyle="miter")
    axes.plot([x], [_TOP], marker="o", markersize=6.5, color=colour)
    side = "right" if left else "left"
    axes.text(end + 6 * outwards, y, fixed(item.mean_rank, 2), ha=side, va="center", color=MUTED)
    axes.text(end + 40 * outwards, y, label(item), ha=side, va="center", color=INK)

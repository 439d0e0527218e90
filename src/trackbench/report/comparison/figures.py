"""The figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle

from trackbench.compare import Comparison, PairDifference
from trackbench.compare.comparison import RankedTracker
from trackbench.document import Figure, TrackerStyle
from trackbench.document.drawing import INK, MUTED, WIDTH
from trackbench.document.margins import shortened, text_width
from trackbench.document.palette import Styles
from trackbench.report.numbers import fixed
from trackbench.report.pairs import groups_of

_WIDTH = 760.0
_ROW = 24.0
_MAP = colormaps["Oranges"]
#: Darker cells would make their numbers hard to read.
_DARKEST = 0.55
#: Times the median from which on all cells are the darkest, and the least such value.
_SATURATED, _LEAST = 2.0, 2.0
_ON_LIGHT = "#1c2126"


def reference_figure(comparison: Comparison) -> Figure:
    """Position RMSE over that of the reference, scenarios down and trackers across."""
    names = [item.tracker for item in comparison.ranking]
    scenarios = [scenario.name for scenario in comparison.scenarios]
    scores = {(score.scenario, score.entrant.tracker): score for score in comparison.scores}
    cells = [[scores.get((scenario, name)) for name in names] for scenario in scenarios]
    values = np.array(
        [[np.nan if s is None else s.value("position_over_reference") for s in row] for row in cells], dtype=float
    )
    finite = values[np.isfinite(values)]
    # One tracker that is many times worse must not make all others look alike.
    darkest = max(_LEAST, _SATURATED * float(np.median(finite))) if finite.size else _LEAST

    widest = max(map(text_width, names))
    upright = widest > (_WIDTH - max(map(text_width, scenarios))) / len(names) - 8

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        for (row, col), value in np.ndenumerate(values):
            if np.isfinite(value):
                shade = _DARKEST * min(1.0, np.log(max(1.0, value)) / np.log(darkest))
                axes.add_patch(Rectangle((col - 0.48, row - 0.46), 0.96, 0.92, color=_MAP(shade)))
                text = fixed(float(value), 2)
            else:
                text = "" if cells[row][col] is None else "n/a"
            # A filled cell is light on a dark page too.
            ink = _ON_LIGHT if np.isfinite(value) else MUTED
            axes.text(col, row, text, ha="center", va="center", color=ink, fontsize=10)
        axes.set_xticks(range(len(names)), names)
        axes.set_yticks(range(len(scenarios)), scenarios)
        axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(len(scenarios) - 0.5, -0.5))
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.tick_params(axis="x", labelrotation=90 if upright else 0)
        axes.spines[:].set_visible(False)
        axes.grid(visible=False)

    return Figure(
        name="over-reference",
        title="Position RMSE over the reference",
        caption="The reference is the Cramér-Rao bound that would hold if the vehicles moved with white acceleration "
        "of the same RMS as theirs. It makes scenarios comparable and is no limit: a tracker can be below 1. Darker is "
        f"larger, and all from {darkest:.1f} times on are the same.",
        alternative="Position RMSE over that of the reference for each scenario and tracker",
        paint=paint,
        height=(widest + 14 if upright else 30) + _ROW * len(scenarios),
        width=_WIDTH,
    )


def difference_figure(metric: str, items: Sequence[PairDifference], labels: Sequence[str], styles: Styles) -> Figure:
    """Each difference in percent with its interval; one that is zero in every run, or against zero, is left out."""
    drawn = [
        (label, item.percent, item.percent_ci95 or (item.percent,) * 2, styles[item.entrant.tracker])
        for label, item in zip(labels, items, strict=True)
        if item.percent is not None and not item.identical
    ]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=f"difference in {metric}, %")
        axes.axvline(0.0, color=INK, linewidth=1)
        for y, (_, value, ends, style) in enumerate(drawn):
            axes.plot(ends, [y, y], color=style.colour, linewidth=5, alpha=0.35)
            axes.plot([value], [y], markersize=6, **style.dot)
        axes.set_yticks(range(len(drawn)), [shortened(label, 0.55 * WIDTH) for label, *_ in drawn])
        axes.set_ylim(len(drawn) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")

    return Figure(
        name=f"differences-{metric.replace('.', '-')}",
        title=f"Differences in {metric}",
        caption="Dots are differences in percent of the value that each is held against, bars their 95 % intervals. "
        "What is the same in every run is left out.",
        alternative=f"Differences in {metric}: " + ", ".join(f"{label} {value:+.1f} %" for label, value, *_ in drawn),
        paint=paint,
        height=50 + _ROW * len(drawn),
    )


def competitors(comparison: Comparison) -> list[RankedTracker]:
    """The ranked trackers, best first."""
    return [item for item in comparison.ranking if not item.reference]


def label(item: RankedTracker) -> str:
    """Its name, and whether it is a reference."""
    return f"{item.tracker} (reference)" if item.reference else item.tracker


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


def rank_figure(comparison: Comparison, styles: Styles) -> Figure:
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
            _paint_tracker(axes, axis, item, y, styles[item.tracker], left=left)

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


def _paint_tracker(axes: Axes, axis: _Axis, item: RankedTracker, y: float, style: TrackerStyle, *, left: bool) -> None:
    """From its place on the axis down to its name at the side."""
    x, outwards = axis.x(item.mean_rank), -1 if left else 1
    end = (axis.side if left else _WIDTH - axis.side) + 20 * outwards
    axes.plot([x, x, end], [_TOP, y, y], color=style.colour, linestyle=style.line, linewidth=1.6)
    axes.plot([x], [_TOP], markersize=6.5, **style.dot)
    side = "right" if left else "left"
    axes.text(end + 6 * outwards, y, fixed(item.mean_rank, 2), ha=side, va="center", color=MUTED)
    axes.text(end + 40 * outwards, y, label(item), ha=side, va="center", color=INK)

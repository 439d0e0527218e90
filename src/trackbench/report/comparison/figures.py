"""The figures of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle

from trackbench.compare import Comparison, PairDifference
from trackbench.document import Figure
from trackbench.document.drawing import INK, MUTED, WIDTH
from trackbench.document.margins import shortened, text_width
from trackbench.report.numbers import fixed

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
    found = [[scores.get((scenario, name)) for name in names] for scenario in scenarios]
    values = np.array(
        [[np.nan if s is None else s.value("position_over_reference") for s in row] for row in found], dtype=float
    )
    known = values[np.isfinite(values)]
    # One tracker that is many times worse must not make all others look alike.
    darkest = max(_LEAST, _SATURATED * float(np.median(known))) if known.size else _LEAST

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
                text = "" if found[row][col] is None else "n/a"
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


def difference_figure(
    metric: str, items: Sequence[PairDifference], labels: Sequence[str], colours: Mapping[str, str]
) -> Figure:
    """Each difference in percent with its interval; one that is zero in every run, or against zero, is left out."""
    drawn = [
        (label, item.percent, item.percent_ci95 or (item.percent,) * 2, colours[item.entrant.tracker])
        for label, item in zip(labels, items, strict=True)
        if item.percent is not None and not item.identical
    ]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=f"difference in {metric}, %")
        axes.axvline(0.0, color=INK, linewidth=1)
        for y, (_, value, ends, colour) in enumerate(drawn):
            axes.plot(ends, [y, y], color=colour, linewidth=5, alpha=0.35)
            axes.plot([value], [y], marker="o", markersize=6, color=colour)
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

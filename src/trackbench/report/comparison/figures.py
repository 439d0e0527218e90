"""Figure of the differences between trackers in a comparison, and labels of its ranked trackers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.compare import Comparison, PairDifference
from trackbench.compare.comparison import RankedTracker
from trackbench.document import Figure, end_of_axis
from trackbench.document.drawing import INK, WIDTH, shortened_to_width
from trackbench.document.palette import Styles
from trackbench.report.tables import unit_after_heading

_ROW = 24.0


def difference_figure(
    metric: str, items: Sequence[PairDifference], labels: Sequence[str], styles: Styles, against: str
) -> Figure:
    """Return a figure of the differences in a metric with their intervals, in the metric's unit.

    A difference that is zero in every run is left out. An outlier, such as a baseline tracker, is cut off and labelled
    with its value.
    """
    drawn = [
        (label, item.difference, item.ci95 or (item.difference,) * 2, styles[item.entrant.tracker])
        for label, item in zip(labels, items, strict=True)
        if not item.identical
    ]
    unit = unit_after_heading(items[0].unit)
    end = end_of_axis(max(map(abs, ends)) for _, _, ends, _ in drawn)
    shown = [side for _, _, ends, _ in drawn for side in ends if abs(side) <= end]
    low, high = min(shown, default=-end), max(shown, default=end)
    low, high = min(low, 0.0), max(high, 0.0)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    quantity = f"{metric} minus that of {against}" if against else f"difference in {metric}"
    has_intervals, cut = any(item.ci95 for item in items), any(not low <= value <= high for _, value, *_ in drawn)
    caption = f"Dots: {quantity}{'; bars: their 95 % intervals' * has_intervals}."
    caption += " Outliers are cut off at the edge, with their values." * cut
    caption += " Differences that are zero in every run are left out." * (len(drawn) < len(items))

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=f"{quantity}{unit}")
        axes.axvline(0.0, color=INK, linewidth=1)
        for y, (_, value, ends, style) in enumerate(drawn):
            axes.plot(np.clip(ends, low, high), [y, y], color=style.colour, linewidth=5, alpha=0.35)
            if low <= value <= high:
                axes.plot([value], [y], markersize=6, **style.point_options)
            else:
                place, side, arrow = (
                    (high, "right", "{} \N{RIGHTWARDS ARROW}") if value > 0 else (low, "left", "\N{LEFTWARDS ARROW} {}")
                )
                axes.text(place, y - 0.1, arrow.format(f"{value:+.3g}"), ha=side, va="bottom", color=INK, fontsize=10)
        axes.set_yticks(range(len(drawn)), [shortened_to_width(label, 0.45 * WIDTH) for label, *_ in drawn])
        axes.set(xlim=(low, high), ylim=(len(drawn) - 0.4, -0.6))
        axes.grid(visible=False, axis="y")

    return Figure(
        name=f"differences-{metric.replace('.', '-')}",
        title=f"Differences in {metric}{unit}",
        caption=caption,
        alternative=f"{quantity}{unit}: " + ", ".join(f"{label} {value:+.3g}" for label, value, *_ in drawn),
        paint=paint,
        height=50 + _ROW * len(drawn),
    )


def competitors(comparison: Comparison) -> list[RankedTracker]:
    """Return the ranked trackers that are not references, best first."""
    return [item for item in comparison.ranking if not item.reference]


def ranked_label(item: RankedTracker) -> str:
    """Return the name of a ranked tracker, marked if it is a reference."""
    return f"{item.tracker} (reference)" if item.reference else item.tracker

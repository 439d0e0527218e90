"""The figure of accuracy against computing time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, TrackerStyle
from trackbench.document.drawing import logarithmic
from trackbench.document.margins import fit_margins, shortened, text_width
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.results import TrackerResult

#: The widest name beside a point, in points: one side of it has room.
_NAME = 150.0


#: In words.
_METRICS = {"position_rmse": "position RMSE", "gospa": "GOSPA"}


def cost_against_accuracy(
    trackers: Sequence[TrackerResult], styles: Mapping[str, TrackerStyle], metric: str
) -> Figure | None:
    """Time per step against the metric that trackers are ranked by, m; None where no time was measured."""
    points = [
        (styles[tracker.name], cost, error)
        for tracker in trackers
        if (cost := _value(tracker, "step_time")) is not None and (error := _value(tracker, metric)) is not None
    ]
    if not points:
        return None
    shown = [style for style, _, _ in points]
    x, y = np.array([cost for _, cost, _ in points]), np.array([error for _, _, error in points])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="µs per step of one run, logarithmic", ylabel=f"{_METRICS[metric]}, m")
        logarithmic(axes, "x")
        if y.max() > 4 * y.min():
            logarithmic(axes, "y")
        for style, cost, error in points:
            axes.plot([cost], [error], marker="o", markersize=9, color=style.colour, linestyle="none", gid=style.key)
        axes.set(xlim=(x.min() / 1.6, x.max() * 1.6))
        axes.margins(y=0.15)
        fit_margins(canvas)
        _label(axes, shown, np.stack([x, y], axis=1))

    said = ", ".join(f"{style.name} {error:.3g} m at {cost:.3g} µs" for style, cost, error in points)
    return Figure(
        "cost",
        "Accuracy against computing time",
        "Each point is a tracker: further down is more accurate, further left is faster. A tracker with another one "
        "both below and to the left of it is slower and less accurate. Times are those of this machine.",
        f"{_METRICS[metric]} against time per step: {said}",
        paint,
        250,
        legend=legend_of(shown),
        tooltips=tooltips_of(shown),
    )


def _value(tracker: TrackerResult, metric: str) -> float | None:
    found = tracker.metrics.get(metric)
    return None if found is None else found.value


def _label(axes: Axes, styles: Sequence[TrackerStyle], points: Array) -> None:
    """Names beside the points, moved up or down until they do not lie on each other."""
    names = [shortened(style.name, _NAME, 10) for style in styles]
    places = axes.transData.transform(points)
    inner = axes.get_window_extent()
    used: list[tuple[float, float, float, float]] = [(x - 6, x + 6, y - 6, y + 6) for x, y in places]
    for i in np.argsort(places[:, 1]):
        x, y = places[i]
        width = text_width(names[i], 10)
        right = x + 9 + width < inner.x1
        left_edge = x + 9 if right else x - 9 - width
        options = [(left_edge, left_edge + width, y + dy - 6, y + dy + 6) for dy in (0, 12, -12, 24, -24, 36, -36, 48)]
        chosen = next((box for box in options if not any(_overlap(box, other) for other in used)), options[0])
        used.append(chosen)
        axes.annotate(
            names[i],
            points[i],
            xytext=(9 if right else -9, (chosen[2] + chosen[3]) / 2 - y),
            textcoords="offset points",
            ha="left" if right else "right",
            va="center",
            fontsize=10,
            gid=styles[i].key,
        )


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]

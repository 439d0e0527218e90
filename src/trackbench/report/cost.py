"""What accuracy costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackbench.report.figures import Look, Picture, entries, logarithmic, titles
from trackbench.report.svg import draw, in_page
from trackbench.types import Array


def cost_against_accuracy(trackers: Sequence[Mapping[str, Any]], shown: Mapping[str, Look]) -> Picture | None:
    """Time per step against position RMSE."""
    points = [
        (shown[t["name"]], cost, t["metrics"]["position_rmse"]["value"])
        for t in trackers
        if (cost := t["metrics"]["step_time"]["value"]) is not None
    ]
    if not points:
        return None
    x, y = (np.array(values) for values in zip(*((cost, error) for _, cost, error in points), strict=True))

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="µs per predict and update of one run, logarithmic", ylabel="position RMSE, m")
        logarithmic(axes, "x")
        if y.max() > 4 * y.min():
            logarithmic(axes, "y")
        for look, cost, error in points:
            axes.plot([cost], [error], marker="o", markersize=9, color=look.colour, linestyle="none", gid=look.key)
        axes.set(xlim=(x.min() / 1.6, x.max() * 1.6))
        axes.margins(y=0.15)
        figure.draw_without_rendering()
        _label(axes, [look for look, _, _ in points], np.stack([x, y], axis=1))

    alternative = "Position RMSE against time per step: " + ", ".join(
        f"{look.name} {error:.3g} m at {cost:.3g} µs" for look, cost, error in points
    )
    caption = (
        "Each point is a tracker: the lower the more accurate, the further left the cheaper. One that has another both "
        "below and to the left of it is not worth its cost here. Times are those of this machine."
    )
    svg = in_page(draw(paint, 250), "cost", alternative, titles(look for look, _, _ in points))
    return Picture("cost", "Cost against accuracy", caption, alternative, svg, entries(look for look, _, _ in points))


def _label(axes: Axes, shown: Sequence[Look], points: Array) -> None:
    """Names beside the points, moved up or down until they do not lie on each other."""
    places = axes.transData.transform(points)
    inner = axes.get_window_extent()
    taken: list[tuple[float, float, float, float]] = [(x - 6, x + 6, y - 6, y + 6) for x, y in places]
    for i in np.argsort(places[:, 1]):
        x, y = places[i]
        width = 6.2 * len(shown[i].name)
        right = x + 9 + width < inner.x1
        left_edge = x + 9 if right else x - 9 - width
        options = [(left_edge, left_edge + width, y + dy - 6, y + dy + 6) for dy in (0, 12, -12, 24, -24, 36, -36, 48)]
        chosen = next((box for box in options if not any(_overlap(box, other) for other in taken)), options[0])
        taken.append(chosen)
        axes.annotate(
            shown[i].name,
            points[i],
            xytext=(9 if right else -9, (chosen[2] + chosen[3]) / 2 - y),
            textcoords="offset points",
            ha="left" if right else "right",
            va="center",
            fontsize=10,
            gid=shown[i].key,
        )


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]

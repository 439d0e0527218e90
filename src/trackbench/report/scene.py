"""The figures without a time axis: where the vehicles went, and what accuracy costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackbench.report.columns import column, names, where
from trackbench.report.figures import Entry, Look, Picture, entries, logarithmic, titles
from trackbench.report.numbers import fixed
from trackbench.report.svg import GRID, INK, MUTED, WIDTH, draw, in_page
from trackbench.types import Array
from trackbench.words import counted

#: A scene longer than this many times its width (a straight road) is drawn stretched across.
_ELONGATED = 4.0
_MARGIN_M = 6.0
_TALLEST = 400.0


@dataclass(frozen=True)
class _Box:
    """What the map shows, m."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def height(self) -> float:
        return self.top - self.bottom


def map_of_run(tables: Mapping[str, pa.Table], run: int, shown: Sequence[Look]) -> Picture | None:
    """The shown run from above: roads, truth, and the estimates of the best and the worst tracker."""
    truth, estimates = tables["truth"], tables["estimates"]
    drawn = list(dict.fromkeys([shown[-1], shown[0]])) if shown else []
    targets = {name: _alive(truth, name) for name in names(where(truth, role="target"), "object")}
    observer = [_alive(truth, name) for name in names(where(truth, role="observer"), "object")]
    box = _box([*targets.values(), *observer])
    if box is None:
        return None
    stretched = box.width > _ELONGATED * box.height
    moments = [_worst_moment(where(estimates, tracker=look.name)) for look in drawn]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="x, m", ylabel="y, m")
        axes.grid(visible=False)
        _roads(axes, tables["roads"])
        for x, y in observer:
            axes.plot(x, y, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
            axes.plot(x[:1], y[:1], color=MUTED, marker="s", markersize=5)
        for look, moment in zip(drawn, moments, strict=True):
            rows = where(estimates, tracker=look.name)
            for name in targets:
                track = where(rows, object=name)
                axes.plot(column(track, "px_m"), column(track, "py_m"), color=look.colour, linewidth=1.2, gid=look.key)
            if moment:
                axes.plot(
                    moment["px_m"], moment["py_m"], marker="o", markersize=11, markerfacecolor="none",
                    markeredgecolor=look.colour, markeredgewidth=2, linestyle="none", gid=look.key,
                )  # fmt: skip
        for name, (x, y) in targets.items():
            axes.plot(x, y, color=INK, linewidth=0.9, linestyle=(0, (4, 2)))
            axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
            axes.annotate(name, (x[-1], y[-1]), xytext=(3, 3), textcoords="offset points", fontsize=9)
        axes.set(xlim=(box.left, box.right), ylim=(box.bottom, box.top))
        if not stretched:
            axes.set_aspect("equal")

    height = 200.0 if stretched else min(_TALLEST, 60 + (WIDTH - 50) * box.height / box.width)
    alternative = (
        f"Map of run {run}: paths of {counted(len(targets), 'vehicle')} over "
        f"{fixed(box.width, 0)} m by {fixed(box.height, 0)} m"
        + (f", with the estimates of {' and '.join(look.name for look in drawn)}." if drawn else ".")
    )
    worst = "; ".join(f"{look.name}: {_say(moment)}" for look, moment in zip(drawn, moments, strict=True) if moment)
    caption = f"Run {run} from above: dashed is the truth, from the dot to the name; the observer's path is dotted. "
    if drawn:
        caption += (
            "Estimates of the best and of the last ranked tracker, each with a ring where its error was largest "
            f"({worst}); the recording shows all trackers. "
        )
    if stretched:
        caption += "The scene is stretched across: the axes differ in scale."
    legend = (
        Entry("truth", "currentColor", "dash"),
        Entry("observer", "var(--muted)", "dash"),
        *entries(reversed(drawn)),
    )
    svg = in_page(draw(paint, height), "map", alternative, titles(drawn))
    return Picture("map", "From above", caption.strip(), alternative, svg, legend)


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


def _roads(axes: Axes, roads: pa.Table) -> None:
    lines, x, y = (column(roads, name) for name in ("line", "x_m", "y_m"))
    for line in np.unique(lines):
        axes.plot(x[lines == line], y[lines == line], color=GRID, linewidth=1.5)


def _alive(truth: pa.Table, name: str) -> tuple[Array, Array]:
    rows = where(truth, object=name)
    alive = column(rows, "alive") > 0
    return column(rows, "px_m")[alive], column(rows, "py_m")[alive]


def _box(paths: Sequence[tuple[Array, Array]]) -> _Box | None:
    """What holds all paths."""
    x = np.concatenate([path[0] for path in paths]) if paths else np.empty(0)
    y = np.concatenate([path[1] for path in paths]) if paths else np.empty(0)
    if not x.size:
        return None
    return _Box(x.min() - _MARGIN_M, x.max() + _MARGIN_M, y.min() - _MARGIN_M, y.max() + _MARGIN_M)


def _worst_moment(rows: pa.Table) -> dict[str, Any] | None:
    """The estimate with the largest position error."""
    error = column(rows, "position_error_m")
    if not np.isfinite(error).any():
        return None
    found: dict[str, Any] = rows.slice(int(np.nanargmax(error)), 1).to_pylist()[0]
    return found


def _say(moment: Mapping[str, Any]) -> str:
    return f"{fixed(moment['position_error_m'], 2)} m, {moment['object']} at {fixed(moment['time_s'], 1)} s"

"""Figures in the plane: covariances, predictions, and sigma points."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, MARKERS
from trackbench.subjects.doctor.exhibits import STATE, Covariances, Points, Predictions, StatedBelief
from trackbench.subjects.doctor.report.exhibits.values import COLOURS, REFERENCE, TRACKER, fit_equal, outline

_HEIGHT = 215.0
_PARTS = {"position, m": slice(0, 2), "velocity, m/s": slice(2, 4)}
#: The tracker's lies on top of the one before where it is the same.
_LINES = {"before": ("solid", 4.0), "right": ("solid", 1.6), "tracker": (DASHED, 1.6)}


def covariances_figure(name: str, of: Covariances) -> Figure:
    """The ellipses of 95 %, before and after."""
    shown = {"before": of.before, "right": of.right, "tracker": of.tracker}
    drawn = {role: one for role, one in shown.items() if one is not None}

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(_PARTS), squeeze=False)[0]
        for axes, (label, plane) in zip(panels, _PARTS.items(), strict=True):
            rings: list[Array] = []
            for role, one in drawn.items():
                style, width = _LINES[role]
                rings.append(outline(np.zeros(2), one.covariance[plane, plane]))
                alpha = 0.6 if role == "before" else 1.0
                axes.plot(
                    *rings[-1], color=COLOURS[role], linestyle=style, linewidth=width, alpha=alpha, gid=f"shown-{role}"
                )
            what, _, unit = label.partition(", ")
            axes.set(xlabel=f"{what[0]}x, {unit}", ylabel=f"{what[0]}y, {unit}")
            fit_equal(axes, rings)

    said = " ".join(
        f"Standard deviation of the {label.partition(', ')[0]}, {label.partition(', ')[2]}: "
        + "; ".join(f"{one.name} {_sigma(one.covariance[plane, plane]):.3g}" for one in drawn.values())
        + "."
        for label, plane in _PARTS.items()
    )
    return Figure(
        name,
        of.title,
        f"{said} Ellipses: 95 %.",
        f"{of.title}. {said}",
        paint,
        _HEIGHT,
        legend=tuple(
            LegendEntry(one.name, COLOURS[role], "dash" if role == "tracker" else "line") for role, one in drawn.items()
        ),
        tooltips={f"shown-{role}": one.name for role, one in drawn.items()},
    )


def _sigma(block: Array) -> float:
    return float(np.sqrt(max(0.0, float(np.trace(block)))))


_PLANES = {"position": slice(0, 2), "velocity": slice(2, 4)}
_UNITS = {"position": "m", "velocity": "m/s"}
_MARKS: dict[str, Literal["dot", "ring", "cross"]] = {"before": "dot", "right": "ring", "tracker": "cross"}
_ONE, _TWO = 300.0, 215.0
#: Distance of two means below which a plane shows no difference, in standard deviations.
_SAME = 0.02


def predictions_figure(name: str, of: Predictions) -> Figure:
    """Means with their ellipses of 95 %, in the planes in which the tracker's and the right one differ."""
    shown = {"before": of.before, "right": of.right, "tracker": of.tracker}
    drawn = {role: one for role, one in shown.items() if one is not None}
    parts = [part for part, plane in _PLANES.items() if _differ(of, plane)] or ["position"]

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(parts), squeeze=False)[0]
        for axes, part in zip(panels, parts, strict=True):
            plane = _PLANES[part]
            axes.set(xlabel=STATE[plane][0], ylabel=STATE[plane][1])
            fit_equal(axes, [shape for role, one in drawn.items() for shape in _draw(axes, role, one, plane)])
            for role in ("right", "tracker"):
                if of.before is not None:
                    ends = np.stack([of.before.mean[plane], drawn[role].mean[plane]], axis=1)
                    axes.plot(*ends, color=COLOURS[role], linestyle=DASHED, linewidth=1.0)

    said = " ".join(_numbers(of, part) for part in parts)
    return Figure(
        name,
        of.title,
        f"{said} Ellipses: 95 %.",
        f"{of.title}. {said}",
        paint,
        _ONE if len(parts) == 1 else _TWO,
        legend=tuple(LegendEntry(one.name, COLOURS[role], _MARKS[role]) for role, one in drawn.items()),
        tooltips={f"shown-{role}": one.name for role, one in drawn.items()},
    )


def _differ(of: Predictions, plane: slice) -> bool:
    """Whether the means differ, relative to the spread of the right one."""
    apart = np.hypot(*(of.tracker.mean - of.right.mean)[plane])
    spread = np.sqrt(np.nan_to_num(np.trace(of.right.covariance[plane, plane])))
    return bool(not np.isfinite(apart) or apart > _SAME * max(float(spread), 1e-9))


def _draw(axes: Axes, role: str, one: StatedBelief, plane: slice) -> list[Array]:
    """Draw a mean with its ellipse, and give back what was drawn."""
    marker, size = MARKERS[_MARKS[role]]
    mean, ring = one.mean[plane], outline(one.mean[plane], one.covariance[plane, plane])
    hollow = "none" if role == "right" else COLOURS[role]
    axes.plot(*ring, color=COLOURS[role], linewidth=1.4)
    axes.plot(
        mean[:1], mean[1:], color=COLOURS[role], marker=marker, markersize=size + 1, markerfacecolor=hollow,
        markeredgewidth=1.8, linestyle="none", gid=f"shown-{role}",
    )  # fmt: skip
    return [mean[:, None], ring]


def _numbers(of: Predictions, part: str) -> str:
    plane, unit = _PLANES[part], _UNITS[part]
    own, right = of.tracker.mean[plane], of.right.mean[plane]
    apart = float(np.hypot(*(own - right)))
    return (
        f"{part.capitalize()}: {_short(of.tracker)} {own[0]:.4g}, {own[1]:.4g} {unit}; {_short(of.right)} "
        f"{right[0]:.4g}, {right[1]:.4g} {unit}: {apart:.3g} {unit} apart."
    )


def _short(one: StatedBelief) -> str:
    """What it is called, without what stands after a comma or colon."""
    return re.split("[,:]", one.name)[0]


_POINTS_HEIGHT = 330.0


def points_figure(name: str, of: Points) -> Figure:
    """The points, and where they have weights these too, as sizes and in the legend."""

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=of.axes[0], ylabel=of.axes[1])
        right = outline(of.right_ring.mean, of.right_ring.covariance, of.right_ring.size)
        drawn: list[Array] = [right, of.tracker]
        axes.plot(*right, color=REFERENCE, linewidth=1.6, gid="ring-right")
        if of.right is not None:
            size = 7.0
            axes.plot(
                *of.right, color=REFERENCE, marker="o", markersize=size, markerfacecolor="none", markeredgewidth=1.6,
                linestyle="none", gid="shown-right",
            )  # fmt: skip
            drawn.append(of.right)
        if of.tracker_ring is not None:
            ring = outline(of.tracker_ring.mean, of.tracker_ring.covariance, of.tracker_ring.size)
            axes.plot(*ring, color=TRACKER, linestyle=DASHED, linewidth=1.6, gid="ring-tracker")
            drawn.append(ring)
        marker, size = ("x", 6.0) if of.right is not None else ("o", 3.0)
        axes.plot(
            *of.tracker, color=TRACKER, marker=marker, markersize=size, markeredgewidth=1.6, linestyle="none",
            gid="shown-tracker",
        )  # fmt: skip
        if of.tracker_ring is not None:
            for ring_of, colour in ((of.right_ring, REFERENCE), (of.tracker_ring, TRACKER)):
                axes.plot(*ring_of.mean[:, None], color=colour, marker="+", markersize=11, markeredgewidth=1.8)
        fit_equal(axes, drawn)

    own, other = ("", "") if of.weight is None else (f", weights {w:.4g}" for w in of.weight)
    entries = [LegendEntry(f"{of.name}{own}", TRACKER, "dot" if of.right is None else "cross")]
    if of.right is not None:
        entries.append(LegendEntry(f"{of.right_name}{other}", REFERENCE, "ring"))
    entries.append(LegendEntry(of.right_ring.name, REFERENCE))
    tooltips = {"shown-tracker": of.name, "shown-right": of.right_name}
    if of.tracker_ring is not None:
        entries.append(LegendEntry(of.tracker_ring.name, TRACKER, "dash"))
    said = _points_text(of)
    return Figure(
        name, of.title, said, f"{of.title}. {said}", paint, _POINTS_HEIGHT, legend=tuple(entries), tooltips=tooltips
    )


def _points_text(of: Points) -> str:
    ring = of.right_ring
    if of.tracker_ring is None or of.right is None or of.weight is None:
        apart = of.tracker - ring.mean[:, None]
        squared = np.einsum("ik,ij,jk->k", apart, np.linalg.inv(ring.covariance), apart)
        inside, count = int(np.sum(squared <= ring.size**2)), of.tracker.shape[1]
        return f"{inside} of {count} are within {ring.name}; RMS {np.sqrt(squared.mean() / 2):.3g} for each component."
    count = of.tracker.shape[1]
    distances = [np.hypot(*(points - points.mean(axis=1, keepdims=True))).mean() for points in (of.tracker, of.right)]
    means = [", ".join(f"{value:.4g}" for value in one.mean) for one in (of.tracker_ring, ring)]
    sigmas = [np.sqrt(max(0.0, float(np.trace(one.covariance)))) for one in (of.tracker_ring, ring)]
    return (
        f"{count} points whose weights sum to {count * of.weight[0]:.4g} (right: {count * of.weight[1]:.4g}), at "
        f"{distances[0] / distances[1]:.3g} times the right distance from their mean. The mean becomes {means[0]} from "
        f"{means[1]}, the standard deviation {sigmas[0]:.3g} from {sigmas[1]:.3g}. The points are drawn here; the "
        "tracker's own are not known."
    )

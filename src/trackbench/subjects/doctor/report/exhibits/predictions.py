"""Two predictions, the tracker's and the right one, and the state before."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, MARKERS
from trackbench.subjects.doctor.exhibits import STATE, Predictions, StatedBelief
from trackbench.subjects.doctor.report.exhibits.roles import COLOURS, fit_equal, outline

_PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}
_UNITS = {"position": "m", "velocity": "m/s"}
_MARKS: dict[str, Literal["dot", "ring", "cross"]] = {"before": "dot", "right": "ring", "tracker": "cross"}
_ONE, _TWO = 300.0, 215.0
#: Distance of two means below which a plane shows no difference, in standard deviations.
_SAME = 0.02


def predictions_figure(name: str, of: Predictions) -> Figure:
    """Means with their ellipses of 95 %, in the planes in which the tracker's and the right one differ."""
    shown = {"before": of.before, "right": of.right, "tracker": of.tracker}
    drawn = {role: one for role, one in shown.items() if one is not None}
    parts = [part for part, plane in _PARTS.items() if _differ(of, plane)] or ["position"]

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(parts), squeeze=False)[0]
        for axes, part in zip(panels, parts, strict=True):
            plane = _PARTS[part]
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
    plane, unit = _PARTS[part], _UNITS[part]
    own, right = of.tracker.mean[plane], of.right.mean[plane]
    apart = float(np.hypot(*(own - right)))
    return (
        f"{part.capitalize()}: {_short(of.tracker)} {own[0]:.4g}, {own[1]:.4g} {unit}; {_short(of.right)} "
        f"{right[0]:.4g}, {right[1]:.4g} {unit}: {apart:.3g} {unit} apart."
    )


def _short(one: StatedBelief) -> str:
    """What it is called, without what stands after a comma or colon."""
    return re.split("[,:]", one.name)[0]

"""Covariances of one state as ellipses around the same point, of position and velocity."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED
from trackbench.subjects.doctor.exhibits import Covariances
from trackbench.subjects.doctor.report.exhibits.roles import COLOURS, fit_equal, outline

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

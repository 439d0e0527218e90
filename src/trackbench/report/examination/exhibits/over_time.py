"""Quantities over time: the tracker's, the right ones, their bounds, and the interval that a finding names."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.doctor.exhibits import Course, OverTime
from trackbench.document import Figure, LegendEntry
from trackbench.document.axes import fit_value_axis
from trackbench.document.drawing import MUTED
from trackbench.report.examination.exhibits.roles import REFERENCE, TRACKER
from trackbench.types import Array, Mask

_PANEL, _LEAST = 170.0, 230.0
#: So few values are drawn as points too.
_FEW = 5


def over_time_figure(name: str, of: OverTime) -> Figure:
    """A panel for each quantity, with the same time."""

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(of.courses), 1, sharex=True, squeeze=False)[:, 0]
        for axes, course in zip(panels, of.courses, strict=True):
            if of.marked is not None:
                axes.axvspan(*of.marked, color=TRACKER, alpha=0.25, gid="marked")
            if course.band is not None:
                axes.fill_between(of.at, *course.band, color=MUTED, alpha=0.35, linewidth=0, gid="band")
            marker = "o" if len(of.at) <= _FEW else None
            if course.right is not None:
                axes.plot(of.at, course.right, color=REFERENCE, marker=marker, gid="shown-right")
            axes.plot(of.at, course.tracker, color=TRACKER, marker=marker, gid="shown-tracker")
            bounds = () if course.band is None else (course.band[1][-1:],)
            right = () if course.right is None else (course.right,)
            axes.set_ylabel(course.label)
            fit_value_axis(axes, [course.tracker, *right, *bounds])
            axes.set_xlim(min(0.0, float(of.at.min())), float(of.at.max()))
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
        panels[-1].set_xlabel(of.axis)

    said = " ".join(_numbers(of, course) for course in of.courses)
    bands = {course.band_name for course in of.courses if course.band is not None}
    entries = [LegendEntry("tracker", TRACKER)]
    if any(course.right is not None for course in of.courses):
        entries.append(LegendEntry(of.right_name, REFERENCE))
    entries += [LegendEntry(band, MUTED, "band") for band in sorted(bands)]
    tooltips = {"shown-tracker": "tracker", "shown-right": of.right_name}
    if of.marked is not None:
        entries.append(LegendEntry(f"{of.marked[0]:g} to {of.marked[1]:g} s", TRACKER, "band"))
        tooltips["marked"] = f"{of.marked[0]:g} to {of.marked[1]:g} s"
    height = max(_LEAST, _PANEL * len(of.courses))
    return Figure(name, of.title, said, f"{of.title}. {said}", paint, height, legend=tuple(entries), tooltips=tooltips)


def _numbers(of: OverTime, course: Course) -> str:
    """Of the marked interval, or at the end."""
    if of.marked is None:
        where, chosen = f"at {of.at[-1]:g} {of.axis.rpartition(', ')[2]}", np.arange(len(of.at)) == len(of.at) - 1
    else:
        where, chosen = f"from {of.marked[0]:g} to {of.marked[1]:g} s", (of.at >= of.marked[0]) & (of.at < of.marked[1])
    label, _, unit = course.label.partition(", ")
    numbers = [f"tracker {_mean(course.tracker, chosen):.3g}"]
    if course.right is not None:
        numbers.append(f"{of.right_name} {_mean(course.right, chosen):.3g}")
    if course.band is not None:
        numbers.append(f"band {_mean(course.band[0], chosen):.3g} to {_mean(course.band[1], chosen):.3g}")
    mean = ", mean" if of.marked is not None else ""
    return f"{label[0].upper()}{label[1:]} {where}{mean}{', ' + unit if unit else ''}: {', '.join(numbers)}."


def _mean(values: Array, chosen: Mask) -> float:
    known = values[chosen & np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan

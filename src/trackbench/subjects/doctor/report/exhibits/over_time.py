"""Quantities over time: the tracker's, the right ones, their bounds, and the interval that a finding names."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.base.types import Array, Mask
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import MUTED
from trackbench.subjects.doctor.exhibits import Course, OverTime
from trackbench.subjects.doctor.report.exhibits.roles import REFERENCE, TRACKER, fit_values

_PANEL, _LEAST = 170.0, 230.0
#: So few values are drawn as points too.
_FEW = 5
#: Of more time than this only so much is drawn, s.
_LONG = 20.0
#: Share of what is right below which a value is next to nothing.
_NOTHING = 1e-3


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
            axes.set_ylabel(course.label)
            _fit(axes, course)
            axes.set_xlim(*_span(of))
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


def _span(of: OverTime) -> tuple[float, float]:
    """All of the time, or where that is long what is around the marked interval."""
    begin, end = min(0.0, float(of.at.min())), float(of.at.max())
    if of.marked is None or end - begin < _LONG:
        return begin, end
    middle = float(np.clip(sum(of.marked) / 2, begin + _LONG / 2, end - _LONG / 2))
    return middle - _LONG / 2, max(middle + _LONG / 2, of.marked[1])


def _fit(axes: Axes, course: Course) -> None:
    """Limits around all; with zero on the axis where the tracker's values are next to nothing."""
    others = [] if course.right is None else [course.right]
    others += [] if course.band is None else [course.band[1]]
    largest = max((float(np.nanmax(one)) for one in others), default=0.0)
    if largest > 0.0 and not (course.tracker > _NOTHING * largest).any():
        axes.set_ylim(-0.05 * largest, 1.06 * largest)
    else:
        fit_values(axes, [course.tracker, *others])


def _numbers(of: OverTime, course: Course) -> str:
    """The means of the marked interval, or the values at both ends."""
    unit = of.axis.rpartition(", ")[2]
    if of.marked is None:
        ends = (0, len(of.at) - 1)
        said = "; ".join(f"at {of.at[k]:.3g} {unit} {_said(of, course, np.arange(len(of.at)) == k)}" for k in ends)
    else:
        within = (of.at >= of.marked[0]) & (of.at < of.marked[1])
        said = f"mean from {of.marked[0]:g} to {of.marked[1]:g} {unit} {_said(of, course, within)}"
    return f"{course.label[0].upper()}{course.label[1:]}: {said}."


def _said(of: OverTime, course: Course, chosen: Mask) -> str:
    numbers = [f"tracker {_mean(course.tracker, chosen):.3g}"]
    if course.right is not None:
        numbers.append(f"{of.right_name} {_mean(course.right, chosen):.3g}")
    if course.band is not None:
        numbers.append(f"band {_mean(course.band[0], chosen):.3g} to {_mean(course.band[1], chosen):.3g}")
    return ", ".join(numbers)


def _mean(values: Array, chosen: Mask) -> float:
    known = values[chosen & np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan

"""The figures of errors over time, with the reference and the spread of the runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, fit_value_axis, panel_title, time_axis
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.report.calibration import UNIT, Quantity
from trackbench.report.numbers import joined
from trackbench.report.run.figures.lines import Line, draw_lines, end_of, last_values, smooth_lines, styles_of
from trackbench.results.scenario_summary import ReferenceSummary

_HEIGHT = 250.0
_PANEL = 125.0


def error_over_time(
    steps: pa.Table, styles: Sequence[TrackerStyle], quantity: Quantity, reference: ReferenceSummary
) -> Figure | None:
    """RMSE of a quantity over time with that of the reference; None if there is nothing to draw."""
    unit = UNIT[quantity]
    suffix = unit.replace("/", "p")
    drawn = smooth_lines(steps, styles, f"{quantity}_rmse_{suffix}")
    references = _distinct(smooth_lines(steps, styles, f"{quantity}_reference_{suffix}"))
    if not drawn:
        return None

    def colour(group: Sequence[Line]) -> str:
        return INK if len(references) == 1 else group[0].style.colour

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=f"{quantity} RMSE, {unit}")
        draw_lines(axes, drawn, end_of(steps))
        for group in references:
            axes.plot(group[0].time, group[0].value, color=colour(group), linestyle=DASHED, linewidth=1.3)
        fit_value_axis(axes, [line.value for line in drawn] + [group[0].value for group in references])

    caption = f"RMSE of the {quantity} over all runs and objects, {_window(drawn)}."
    if references:
        caption += f" Dashed: the {reference.label}. {reference.meaning}"
    shown = styles_of(drawn)
    keys = [LegendEntry(_label(reference, group, len(references)), colour(group), "dash") for group in references]
    return Figure(
        f"{quantity}-error",
        f"{quantity.capitalize()} error over time",
        caption,
        f"RMSE of {quantity} over time, {counted(len(drawn), 'tracker')}. {last_values(drawn, unit)}",
        paint,
        _HEIGHT,
        legend=(*legend_of(shown), *keys),
        tooltips=tooltips_of(shown),
    )


def spread(steps: pa.Table, styles: Sequence[TrackerStyle], reference: str) -> Figure | None:
    """A panel per tracker: its position RMSE within the spread of the runs, and that of what ``reference`` names."""
    drawn = smooth_lines(steps, styles, "position_rmse_m")
    low = {line.style.key: line.value for line in smooth_lines(steps, styles, "position_p10_m")}
    high = {line.style.key: line.value for line in smooth_lines(steps, styles, "position_p90_m")}
    references = {line.style.key: line for line in smooth_lines(steps, styles, "position_reference_m")}
    # One object in one run has no spread.
    if not drawn or all(key in high and np.array_equal(low[key], high[key], equal_nan=True) for key in low):
        return None
    columns = 2 if len(drawn) > 1 else 1
    rows = -(-len(drawn) // columns)

    def paint(canvas: Canvas) -> None:
        panels = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for number, (axes, line) in enumerate(zip(panels, drawn, strict=False)):
            key = line.style.key
            if key in low and key in high:
                axes.fill_between(line.time, low[key], high[key], color=line.style.colour, alpha=0.3)
            axes.plot(line.time, line.value, color=line.style.colour)
            if key in references:
                axes.plot(references[key].time, references[key].value, color=INK, linestyle=DASHED, linewidth=1.2)
            panel_title(axes, line.style.name, WIDTH / columns)
            axes.set_xlabel(TIME_LABEL if number >= columns * (rows - 1) else "")
            axes.set_ylabel("error, m" if number % columns == 0 else "")
        for axes in panels[len(drawn) :]:
            axes.set_visible(False)
        time_axis(panels[0], end_of(steps))
        fit_value_axis(panels[0], [*high.values(), *low.values(), *(line.value for line in drawn)])

    shown = counted(len(drawn), "tracker")
    return Figure(
        "position-spread",
        "Spread of the runs",
        "One panel per tracker, on the same axes: the line is the RMSE, the band holds the middle 80 % of the errors "
        f"of single runs and objects, {_window(drawn)}; dashed is the {reference}. Where the line is above its "
        "band, the errors of a few runs are far larger than the rest.",
        f"Position error over time with the spread of the runs, one panel for each of {shown}.",
        paint,
        max(_HEIGHT, 40 + _PANEL * rows),
        legend=(
            LegendEntry("RMSE", MUTED),
            LegendEntry("10th to 90th percentile", MUTED, "band"),
            *([LegendEntry(reference, INK, "dash")] if references else []),
        ),
    )


def _window(drawn: Sequence[Line]) -> str:
    return f"averaged over {np.diff(drawn[0].time[:2]).sum():.2g} s"


def _distinct(drawn: Sequence[Line]) -> list[list[Line]]:
    """Lines grouped by what they show: trackers of the same sensors have the same reference."""
    groups: list[list[Line]] = []
    for line in drawn:
        for group in groups:
            other = group[0]
            if other.value.shape == line.value.shape and np.allclose(other.value, line.value, equal_nan=True):
                group.append(line)
                break
        else:
            groups.append([line])
    return groups


def _label(reference: ReferenceSummary, group: Sequence[Line], groups: int) -> str:
    return reference.label if groups == 1 else f"{reference.label} of {joined([line.style.name for line in group])}"

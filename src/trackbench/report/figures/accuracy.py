"""Figures of errors: over time with their spread, by manoeuvre and range band, and against computing time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.axes import fit_margins, shortened_to_width, text_width
from trackbench.document.drawing import (
    DASHED,
    INK,
    LOG_ABOVE,
    MUTED,
    TIME_LABEL,
    WIDTH,
    fit_value_axis,
    logarithmic,
    panel_title,
    time_axis,
)
from trackbench.document.palette import tracker_figure
from trackbench.report.calibration import TITLE, UNIT, By, Quantity, condition_names, rmse, scores_by_condition
from trackbench.report.figures.over_time import (
    Line,
    beyond_axis,
    draw_lines,
    end_of,
    last_values,
    panel_grid,
    rms_by_name,
    smooth_lines,
    styles_of,
)
from trackbench.report.numbers import joined_names
from trackbench.report.tables import metric_of
from trackbench.results import MetricValue, TrackerResult
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
    cut, words = beyond_axis(rms_by_name(drawn), unit)

    def colour(group: Sequence[Line]) -> str:
        return INK if len(references) == 1 else group[0].style.colour

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=f"{quantity} RMSE, {unit}")
        draw_lines(axes, drawn, end_of(steps))
        for group in references:
            axes.plot(group[0].time, group[0].value, color=colour(group), linestyle=DASHED, linewidth=1.3)
        near = [line.value for line in (*drawn, *(group[0] for group in references)) if line.style.name not in cut]
        fit_value_axis(axes, near)
        panel_title(axes, words, WIDTH)

    caption = f"RMSE of the {quantity} over all runs and objects, {_window(drawn)}.{_sentence(words)}"
    if references:
        caption += f" Dashed: the {reference.label}. {reference.meaning}"
    shown = styles_of(drawn)
    keys = [LegendEntry(_label(reference, group, len(references)), colour(group), "dash") for group in references]
    return tracker_figure(
        f"{quantity}-error",
        f"{quantity.capitalize()} error over time",
        caption,
        f"RMSE of {quantity} over time, {counted(len(drawn), 'tracker')}. {last_values(drawn, unit)}",
        paint,
        _HEIGHT,
        shown,
        *keys,
    )


def spread(steps: pa.Table, styles: Sequence[TrackerStyle], reference: str) -> Figure | None:
    """A panel per tracker: its position RMSE within the spread of the runs, and that of what ``reference`` names."""
    drawn = smooth_lines(steps, styles, "position_rmse_m")
    low = {line.style.key: line.value for line in smooth_lines(steps, styles, "position_p10_m")}
    high = {line.style.key: line.value for line in smooth_lines(steps, styles, "position_p90_m")}
    references = {line.style.key: line for line in smooth_lines(steps, styles, "position_reference_m")}
    far, _ = beyond_axis(rms_by_name(drawn), "m")
    upper = [line._replace(value=high.get(line.style.key, line.value)) for line in drawn]
    cut, words = beyond_axis(rms_by_name(upper), "m")
    drawn = [line for line in drawn if line.style.name not in cut]
    if above := joined_names([line.style.name for line in drawn if line.style.name in far]):
        words = "; ".join(filter(None, [words, f"{above}: RMSE beyond the axis, band on it"]))
    # One object in one run has no spread.
    if not drawn or all(key in high and np.array_equal(low[key], high[key], equal_nan=True) for key in low):
        return None
    rows = -(-len(drawn) // 2)

    def draw(axes: Axes, number: int) -> None:
        line, key = drawn[number], drawn[number].style.key
        if key in low and key in high:
            axes.fill_between(line.time, low[key], high[key], color=line.style.colour, alpha=0.3)
        axes.plot(line.time, line.value, color=line.style.colour)
        if key in references:
            axes.plot(references[key].time, references[key].value, color=INK, linestyle=DASHED, linewidth=1.2)

    def paint(canvas: Canvas) -> None:
        axes = panel_grid(canvas, [line.style.name for line in drawn], "error, m", draw)
        time_axis(axes, end_of(steps))
        shown = {line.style.key for line in drawn}
        bands = [value for of_key in (high, low) for key, value in of_key.items() if key in shown]
        fit_value_axis(axes, [*bands, *(line.value for line in drawn if line.style.name not in far)])

    shown = counted(len(drawn), "tracker")
    return Figure(
        "position-spread",
        "Spread of the runs",
        "One panel per tracker, on the same axes: the line is the RMSE, the band holds the middle 80 % of the errors "
        f"of single runs and objects, {_window(drawn)}; dashed is the {reference}. Where the line is above its "
        f"band, the errors of a few runs are far larger than the rest.{_sentence(words)}",
        f"Position error over time with the spread of the runs, one panel for each of {shown}.",
        paint,
        max(_HEIGHT, 40 + _PANEL * rows),
        legend=(
            LegendEntry("RMSE", MUTED),
            LegendEntry("10th to 90th percentile", MUTED, "band"),
            *([LegendEntry(reference, INK, "dash")] if references else []),
        ),
    )


def _sentence(words: str) -> str:
    """What goes beyond an axis, after another sentence."""
    return f" {words}." if words else ""


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
    return (
        reference.label if groups == 1 else f"{reference.label} of {joined_names([line.style.name for line in group])}"
    )


_CLASS_HEIGHT = 230.0
#: Width of the dots of one class, of the distance between classes.
_CLASS_WIDTH = 0.7

_Errors = Sequence[MetricValue | None]


def errors_by_class(
    trackers: Sequence[TrackerResult], styles: Mapping[str, TrackerStyle], by: By, quantity: Quantity
) -> Figure | None:
    """RMSE of each tracker in each class; None with fewer than two classes."""
    names = condition_names(trackers, by)
    if len(names) < 2:
        return None
    errors = [
        (styles[tracker.name], [rmse(scores_by_condition(tracker, by).get(name), quantity) for name in names])
        for tracker in trackers
    ]
    unit = UNIT[quantity]
    largest = {style.name: max(_values(metrics), default=0.0) for style, metrics in errors}
    cut, beyond = beyond_axis(largest, unit)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(ylabel=f"{quantity} RMSE, {unit}")
        near = [(style, metrics) for style, metrics in errors if style.name not in cut]
        for i, (style, metrics) in enumerate(near):
            shift = _CLASS_WIDTH * ((i + 0.5) / len(near) - 0.5)
            _dots(axes, shift, metrics, style)
        panel_title(axes, beyond, WIDTH)
        values = np.array([value for _, metrics in near for value in _values(metrics)])
        if values.size and values.min() > 0 and values.max() > LOG_ABOVE / 2 * values.min():
            logarithmic(axes, "y")
            axes.set_ylabel(f"{quantity} RMSE, {unit}, log.")
        else:
            axes.set_ylim(0, None)
        labels = [name.replace(" to ", " to\n").replace("sensor gap", "sensor\ngap") for name in names]
        axes.set_xticks(range(len(names)), labels)
        axes.set_xlim(-0.55, len(names) - 0.45)
        for x in range(1, len(names)):
            axes.axvline(x - 0.5, color=axes.xaxis.get_gridlines()[0].get_color(), linewidth=1)
        axes.grid(visible=False, axis="x")
        axes.tick_params(axis="x", length=0)

    what = TITLE[by]
    shown = [style for style, _ in errors]
    words = " ".join(_errors_in_words(style, names, metrics, unit) for style, metrics in errors)
    return tracker_figure(
        f"{quantity}-by-{by}",
        f"{quantity.capitalize()} error by {what}",
        f"RMSE of the {quantity} in each {what}, over all runs and objects; the bars are 95 % intervals."
        f"{_sentence(beyond and f'{beyond}, the largest of them')}",
        f"RMSE of {quantity} by {what}. {words}",
        paint,
        _CLASS_HEIGHT,
        shown,
    )


def _values(metrics: _Errors) -> list[float]:
    return [metric.value for metric in metrics if metric is not None and metric.value is not None]


def _dots(axes: Axes, shift: float, metrics: _Errors, style: TrackerStyle) -> None:
    places = [(x + shift, m.value, m.ci95) for x, m in enumerate(metrics) if m is not None and m.value is not None]
    # An interval that reaches zero has no place on a logarithmic axis.
    bars = [(x, (max(ci95[0], 0.2 * value), ci95[1])) for x, value, ci95 in places if ci95 is not None]
    if bars:
        across = [place for x, _ in bars for place in (x, x, np.nan)]
        upwards = [end for _, ends in bars for end in (*ends, np.nan)]
        axes.plot(across, upwards, color=style.colour, linewidth=1.4, gid=style.key)
    if places:
        x, value, _ = zip(*places, strict=True)
        axes.plot(x, value, markersize=6, **style.dot)


def _errors_in_words(style: TrackerStyle, names: Sequence[str], metrics: _Errors, unit: str) -> str:
    values = [
        f"{name} {metric.value:.3g} {unit}"
        for name, metric in zip(names, metrics, strict=True)
        if metric is not None and metric.value is not None
    ]
    return f"{style.name}: {joined_names(values)}."


#: The widest name beside a point, in points: one side of it has room.
_NAME = 150.0


#: In words.
_METRICS = {"position_rmse": "position RMSE", "tgospa": "T-GOSPA"}


def cost_against_accuracy(
    trackers: Sequence[TrackerResult], styles: Mapping[str, TrackerStyle], metric: str
) -> Figure | None:
    """Time per step against the metric that trackers are ranked by, m; None where no time was measured."""
    points = [
        (
            styles[tracker.name],
            cost,
            error,
            () if tracker.health.diverged_runs else metric_of(tracker, metric).ci95 or (),
        )
        for tracker in trackers
        if (cost := metric_of(tracker, "step_time").value) is not None
        and (error := metric_of(tracker, metric).value) is not None
    ]
    if not points:
        return None
    words = ", ".join(f"{style.name} {error:.3g} m at {cost:.3g} µs" for style, cost, error, _ in points)
    cut, beyond = beyond_axis({style.name: error for style, _, error, _ in points}, "m")
    points = [point for point in points if point[0].name not in cut]
    shown = [style for style, *_ in points]
    x, y = np.array([cost for _, cost, *_ in points]), np.array([error for _, _, error, _ in points])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="µs per step of one run, logarithmic", ylabel=f"{_METRICS[metric]}, m")
        logarithmic(axes, "x")
        if y.max() > 4 * y.min():
            logarithmic(axes, "y")
        for style, cost, error, ends in points:
            axes.plot([cost] * len(ends), ends, color=style.colour, linewidth=1.4, gid=style.key)
            axes.plot([cost], [error], markersize=9, **style.dot)
        axes.set(xlim=(x.min() / 1.6, x.max() * 1.6))
        axes.margins(y=0.15)
        panel_title(axes, "; ".join(filter(None, ["the axis of errors does not begin at 0", beyond])), WIDTH)
        fit_margins(canvas)
        _label_points(axes, shown, np.stack([x, y], axis=1))

    return tracker_figure(
        "cost",
        "Accuracy against computing time",
        "Each point is a tracker: further down is the smaller error, further left is faster. The axis of errors does "
        "not begin at 0. The bars are 95 % intervals of each alone; which differences are shown, the table says. Times "
        "are those of this machine."
        f"{_sentence(beyond)}",
        f"{_METRICS[metric]} against time per step: {words}",
        paint,
        250,
        shown,
    )


def _label_points(axes: Axes, styles: Sequence[TrackerStyle], points: Array) -> None:
    """Names beside the points, moved up or down until they do not lie on each other."""
    names = [shortened_to_width(style.name, _NAME, 10) for style in styles]
    places = axes.transData.transform(points)
    inner = axes.get_window_extent()
    used: list[tuple[float, float, float, float]] = [(x - 6, x + 6, y - 6, y + 6) for x, y in places]
    for i in np.argsort(places[:, 1]):
        x, y = places[i]
        width = text_width(names[i], 10)
        right = x + 9 + width < inner.x1
        left_edge = x + 9 if right else x - 9 - width
        boxes = [(left_edge, left_edge + width, y + dy - 6, y + dy + 6) for dy in (0, 12, -12, 24, -24, 36, -36, 48)]
        options = [box for box in boxes if inner.y0 < box[2] and box[3] < inner.y1] or boxes
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

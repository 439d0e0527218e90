"""The figure of errors by manoeuvre or by range band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure, TrackerStyle
from trackbench.document.drawing import LOG_ABOVE, logarithmic
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.report.calibration import TITLE, UNIT, By, Quantity, classes, conditions, rmse
from trackbench.report.numbers import joined
from trackbench.results import MetricValue, TrackerResult

_HEIGHT = 230.0
#: Width of the dots of one class, of the distance between classes.
_SPREAD = 0.7

_Errors = Sequence[MetricValue | None]


def errors_by_class(
    trackers: Sequence[TrackerResult], styles: Mapping[str, TrackerStyle], by: By, quantity: Quantity
) -> Figure | None:
    """RMSE of each tracker in each class; None with fewer than two classes."""
    names = classes(trackers, by)
    if len(names) < 2:
        return None
    found = [
        (styles[tracker.name], [rmse(conditions(tracker, by).get(name), quantity) for name in names])
        for tracker in trackers
    ]
    unit = UNIT[quantity]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(ylabel=f"{quantity} RMSE, {unit}")
        for i, (style, metrics) in enumerate(found):
            shift = _SPREAD * ((i + 0.5) / len(found) - 0.5)
            _dots(axes, shift, metrics, style)
        values = np.array([m.value for _, metrics in found for m in metrics if m is not None and m.value is not None])
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
    shown = [style for style, _ in found]
    said = " ".join(_said(style, names, metrics, unit) for style, metrics in found)
    return Figure(
        f"{quantity}-by-{by}",
        f"{quantity.capitalize()} error by {what}",
        f"RMSE of the {quantity} in each {what}, over all runs and objects; the bars are 95 % intervals.",
        f"RMSE of {quantity} by {what}. {said}",
        paint,
        _HEIGHT,
        legend=legend_of(shown),
        tooltips=tooltips_of(shown),
    )


def _dots(axes: Axes, shift: float, metrics: _Errors, style: TrackerStyle) -> None:
    known = [(x + shift, m.value, m.ci95) for x, m in enumerate(metrics) if m is not None and m.value is not None]
    # An interval that reaches zero has no place on a logarithmic axis.
    bars = [(x, (max(ci95[0], 0.2 * value), ci95[1])) for x, value, ci95 in known if ci95 is not None]
    if bars:
        across = [place for x, _ in bars for place in (x, x, np.nan)]
        upwards = [end for _, ends in bars for end in (*ends, np.nan)]
        axes.plot(across, upwards, color=style.colour, linewidth=1.4, gid=style.key)
    if known:
        x, value, _ = zip(*known, strict=True)
        axes.plot(x, value, marker="o", markersize=6, color=style.colour, linestyle="none", gid=style.key)


def _said(style: TrackerStyle, names: Sequence[str], metrics: _Errors, unit: str) -> str:
    values = [
        f"{name} {metric.value:.3g} {unit}"
        for name, metric in zip(names, metrics, strict=True)
        if metric is not None and metric.value is not None
    ]
    return f"{style.name}: {joined(values)}."

"""Figures by manoeuvre and by range band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackbench.report.breakdown_tables import By, classes
from trackbench.report.figures import LOG_ABOVE, Look, Picture, entries, logarithmic, titles
from trackbench.report.numbers import joined
from trackbench.report.svg import draw, in_page
from trackbench.report.wording import Tracker

_HEIGHT = 230.0
#: Width of the dots of one class, of the distance between classes.
_SPREAD = 0.7
_WHAT = {"manoeuvre": "manoeuvre", "range": "range band"}


def errors_by_class(
    trackers: list[Tracker], shown: Mapping[str, Look], by: By, quantity: str, unit: str
) -> Picture | None:
    """RMSE of ``quantity`` ("position" or "velocity") of each tracker in each class; None with fewer than two."""
    names = classes(trackers, by)
    if len(names) < 2:
        return None
    found = [
        (shown[t["name"]], [t["breakdown"][by].get(name, {}).get(f"{quantity}_rmse") for name in names])
        for t in trackers
    ]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(ylabel=f"{quantity} RMSE, {unit}")
        for i, (look, metrics) in enumerate(found):
            shift = _SPREAD * ((i + 0.5) / len(found) - 0.5)
            for x, metric in enumerate(metrics):
                if metric:
                    _dot(axes, x + shift, metric, look)
        values = np.array([metric["value"] for _, metrics in found for metric in metrics if metric])
        if values.min() > 0 and values.max() > LOG_ABOVE / 2 * values.min():
            logarithmic(axes, "y")
            axes.set_ylabel(f"{quantity} RMSE, {unit}, log.")
        else:
            axes.set_ylim(0, None)
        axes.set_xticks(
            range(len(names)), [name.replace(" to ", " to\n").replace("sensor gap", "sensor\ngap") for name in names]
        )
        axes.set_xlim(-0.55, len(names) - 0.45)
        for x in range(1, len(names)):
            axes.axvline(x - 0.5, color=axes.xaxis.get_gridlines()[0].get_color(), linewidth=1)
        axes.grid(visible=False, axis="x")
        axes.tick_params(axis="x", length=0)

    what = _WHAT[by]
    name = f"{quantity}-by-{by}"
    alternative = f"RMSE of {quantity} by {what}. " + " ".join(
        _said(look, names, metrics, unit) for look, metrics in found
    )
    caption = f"RMSE of the {quantity} in each {what}, over all runs and objects; the bars are 95 % intervals."
    svg = in_page(draw(paint, _HEIGHT), name, alternative, titles(look for look, _ in found))
    title = f"{quantity.capitalize()} error by {what}"
    return Picture(name, title, caption, alternative, svg, entries(look for look, _ in found))


def _dot(axes: Axes, x: float, metric: Mapping[str, Any], look: Look) -> None:
    if metric["ci95"]:
        low, high = metric["ci95"]
        # An interval that reaches zero has no place on a logarithmic axis.
        axes.plot([x, x], [max(low, 0.2 * metric["value"]), high], color=look.colour, linewidth=1.4, gid=look.key)
    axes.plot([x], [metric["value"]], marker="o", markersize=6, color=look.colour, linestyle="none", gid=look.key)


def _said(look: Look, names: Sequence[str], metrics: Sequence[Mapping[str, Any] | None], unit: str) -> str:
    values = [f"{name} {metric['value']:.3g} {unit}" for name, metric in zip(names, metrics, strict=True) if metric]
    return f"{look.name}: {joined(values)}."

"""The figures of the report of a tuning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations, islice
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, Locator, NullLocator

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, MUTED, logarithmic, shortened_to_width
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.subjects.tuning.measures import NEES_DOF
from trackbench.subjects.tuning.objectives import has_nees, mean_nees
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.search import Response, ResponsePoint
from trackbench.subjects.tuning.study import TuningTrial
from trackbench.subjects.tuning.tune import Tuning

_LINE, _BEST = TRACKER_COLOURS[0], TRACKER_COLOURS[4]
_HEIGHT = 230.0
#: A rise of an error beyond which a figure does not go: the optimum is what it shows, %.
_HIGHEST = 60.0
#: Of an axis of probabilities, whose numbers are long.
_FEWEST_NUMBERS, _MOST_NUMBERS = 3, 5
#: Room for the name of an option beside and below a figure of a pair, points.
_BESIDE, _BELOW = 215.0, 340.0
#: Figures of pairs, at most.
_MOST_PAIRS = 6
_SHADES = ("#08306b", "#2171b5", "#6baed6", "#c6dbef")


def response_figure(item: Tuning, response: Response, name: str) -> Figure | None:
    """The objective along one option; None of one that is a choice."""
    parameter = response.parameter
    if parameter.scale == "choice":
        return None
    points = [point for point in response.points if point.parts]
    x = np.array([point.value for point in points], dtype=float)
    with_nees = has_nees(item.best.parts)
    start = None if item.start is None else item.start[parameter.key]

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(2 if with_nees else 1, 1, sharex=True, squeeze=False)[:, 0]
        _scale(panels[0], parameter, "x")
        if with_nees:
            _errors(panels[0], x, points, item)
            panels[1].plot(x, [mean_nees(point.parts) for point in points], color=_LINE, marker="o", markersize=4)
            panels[1].axhline(NEES_DOF, color=MUTED, linewidth=0.8)
            logarithmic(panels[1], "y")
            panels[1].set_ylabel("mean NEES")
        else:
            _rises(panels[0], x, points, item)
        for axes in panels:
            axes.axvline(float(item.best.values[parameter.key]), color=_BEST, linewidth=1.2)
            if start is not None:
                axes.axvline(float(start), color=INK, linestyle=DASHED, linewidth=1.0)
        panels[-1].set_xlabel(shortened_to_width(parameter.key, _BELOW))

    legend = [LegendEntry("tuned", _BEST), *([LegendEntry("start", INK, "dash")] if start is not None else [])]
    band = (
        ""
        if with_nees or not response.has_reach
        else "; the band is the 95 % interval of the difference, from the same runs"
    )
    return Figure(
        f"{name}response-{_file(parameter.key)}",
        parameter.key,
        f"The objective where this option alone differs from the tuned values{band}.",
        f"The objective over {parameter.key}",
        paint,
        _HEIGHT * (1.6 if with_nees else 1.0),
        legend=tuple(legend),
    )


def _rises(axes: Axes, x: Array, points: Sequence[ResponsePoint], item: Tuning) -> None:
    """How much worse the objective is, with its interval."""
    relative = item.objective.measure != "log_likelihood"
    rise = np.array([point.rise for point in points])
    reach = np.array([point.reach or 0.0 for point in points])
    low, middle, high = (
        100 * np.expm1(values) if relative else values for values in (rise - reach, rise, rise + reach)
    )
    axes.fill_between(x, low, high, color=_LINE, alpha=0.2)
    axes.plot(x, middle, color=_LINE, marker="o", markersize=4)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    # The optimum is what it shows, not how bad the worst is.
    top = min(_HIGHEST, float(middle.max())) if relative else float(middle.max())
    axes.set_ylim(-0.1 * top - 1e-9, 1.1 * top + 1e-9)
    axes.set_ylabel("worse by, %" if relative else "log-likelihood lost")


def _errors(axes: Axes, x: Array, points: Sequence[ResponsePoint], item: Tuning) -> None:
    """How far the error is from that of the tuned values."""
    change = np.array([100 * math.expm1(point.parts["error"] - item.best.parts["error"]) for point in points])
    axes.plot(x, change, color=_LINE, marker="o", markersize=4)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    axes.set_ylim(1.1 * min(float(change.min()), -1.0), 1.1 * min(_HIGHEST, max(float(change.max()), 1.0)))
    axes.set_ylabel("error, %")


def pair_figures(item: Tuning, name: str) -> list[Figure]:
    """The trials over each pair of continuous options."""
    pairs = combinations([parameter for parameter in item.parameters if parameter.continuous], 2)
    return [_pair(item, first, second, name) for first, second in islice(pairs, _MOST_PAIRS)]


def _pair(item: Tuning, first: Parameter, second: Parameter, name: str) -> Figure:
    done = [trial for trial in item.trials if trial.losses]
    rank = np.array([item.objective.rank(trial.parts) for trial in done])
    # By rank, the best quarter darkest: losses differ by orders of magnitude.
    quarter = (4 * np.argsort(np.argsort(rank)) // len(done)).astype(int)

    def paint(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for number in range(3, -1, -1):
            chosen = [trial for trial, part in zip(done, quarter, strict=True) if part == number]
            x, y = ([float(trial.values[parameter.key]) for trial in chosen] for parameter in (first, second))
            axes.plot(x, y, linestyle="none", marker="o", markersize=5, color=_SHADES[number])
        for values, marker, colour in ((item.best.values, "o", _BEST), (item.start, "^", INK)):
            if values is not None:
                x, y = ([float(values[parameter.key])] for parameter in (first, second))
                axes.plot(x, y, linestyle="none", marker=marker, markersize=10, markerfacecolor="none", color=colour)
        _scale(axes, first, "x")
        _scale(axes, second, "y")
        axes.set_xlabel(shortened_to_width(first.key, _BELOW))
        axes.set_ylabel(shortened_to_width(second.key, _BESIDE))

    legend = [
        LegendEntry("tuned", _BEST, "ring"),
        *([LegendEntry("start", INK, "triangle")] if item.start is not None else []),
        *(
            LegendEntry(f"{word} quarter", _SHADES[i], "dot")
            for i, word in enumerate(("best", "second", "third", "last"))
        ),
    ]
    return Figure(
        f"{name}pair-{_file(first.key)}-{_file(second.key)}",
        f"{first.key} and {second.key}",
        "Every trial, the better ones darker.",
        f"The trials over {first.key} and {second.key}",
        paint,
        _HEIGHT + 40,
        legend=tuple(legend),
    )


def front_figure(item: Tuning, name: str) -> Figure:
    """All trials by both losses, and the front."""
    done = [trial for trial in item.trials if trial.losses]
    near = [trial for trial in done if trial.losses[0] < math.log(1.5) and trial.losses[1] < math.log(5)] or done
    front = item.front

    def paint(canvas: Canvas) -> None:
        axes = canvas.subplots()
        series: list[tuple[Sequence[TuningTrial], dict[str, Any]]] = [
            (near, {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": MUTED}),
            ([trial for trial in front if trial in near], {"color": _LINE, "marker": "o", "markersize": 5}),
        ]
        if item.best.losses:
            ring = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "color": _BEST}
            series.append(([item.best], {"linestyle": "none", **ring}))
        for trials, style in series:
            axes.plot(*(np.exp([trial.losses[axis] for trial in trials]) for axis in (0, 1)), **style)
        logarithmic(axes, "y")
        axes.set_xlabel(item.objective.axes[0])
        axes.set_ylabel(item.objective.axes[1])

    legend = (LegendEntry("front", _LINE), LegendEntry("trials", MUTED, "dot"), LegendEntry("written", _BEST, "ring"))
    return Figure(
        f"{name}front",
        "Error and consistency",
        "Of the trials on the front none is better in one without being worse in the other.",
        "The position error over the factor by which the mean NEES is off",
        paint,
        _HEIGHT + 40,
        legend=legend,
    )


def _scale(axes: Axes, parameter: Parameter, which: Any) -> None:
    if parameter.scale == "log":
        logarithmic(axes, which)
    elif parameter.scale == "odds":
        (axes.set_xscale if which == "x" else axes.set_yscale)("logit")
        axis = axes.xaxis if which == "x" else axes.yaxis
        axis.set_major_locator(_Odds())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10g}"))
        axis.set_minor_locator(NullLocator())


class _Odds(Locator):
    """Probabilities at 0.1, 0.01 and so on, and as far from one; at twice and five times that too where few are.

    It gives arrays, as matplotlib's own locators do whatever they declare.
    """

    def __call__(self) -> Array:  # type: ignore[override]
        return self.tick_values(*self.axis.get_view_interval())  # type: ignore[union-attr]

    def tick_values(self, vmin: float, vmax: float) -> Array:  # type: ignore[override]
        numbers: list[float] = []
        for digits in ((1,), (1, 2, 5)):
            tails = {0.5, *(round(digit * 10.0**-power, 12) for digit in digits for power in range(1, 10))}
            places = tails | {round(1.0 - tail, 12) for tail in tails}
            numbers = sorted(place for place in places if vmin <= place <= vmax)
            if len(numbers) >= _FEWEST_NUMBERS:
                break
        return np.array(numbers[:: math.ceil(len(numbers) / _MOST_NUMBERS) or 1])


def _file(key: str) -> str:
    return key.replace(".", "-").replace("_", "-")

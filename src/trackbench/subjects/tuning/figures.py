"""The figure of a tuning: the loss of its trials against one option."""

from __future__ import annotations

import math

from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, logarithmic, shortened_to_width
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.tune import Tuning

_TRIAL, _BEST = TRACKER_COLOURS[0], TRACKER_COLOURS[4]
_HEIGHT, _WIDTH = 230.0, 340.0
#: Upper end of the vertical axis, % above the best trial's error, so that the optimum is visible.
_HIGHEST = 60.0


def trials_figure(item: Tuning, parameter: Parameter, name: str = "") -> Figure:
    """Return the figure of all trials' losses against one numeric option; ``name`` is a prefix of the figure's name."""
    relative = item.objective.measure != "log_likelihood"
    succeeded = [trial for trial in item.trials if not trial.failed]
    values = [float(trial.values[parameter.key]) for trial in succeeded]
    rises = [trial.loss - item.best.loss for trial in succeeded]
    if relative:
        rises = [100 * math.expm1(min(rise, 1.0)) for rise in rises]
    legend = [LegendEntry("trial", _TRIAL, "dot"), LegendEntry("tuned", _BEST), LegendEntry("start", INK, "dash")]
    start = item.start[parameter.key]
    top = min(_HIGHEST, max(rises)) if relative else max(rises)

    def paint(canvas: Canvas) -> None:
        axes = canvas.subplots()
        if parameter.scale == "log":
            logarithmic(axes, "x")
        elif parameter.scale == "odds":
            axes.set_xscale("logit")
        axes.plot(values, rises, linestyle="none", marker="o", markersize=4, color=_TRIAL)
        axes.axvline(float(item.best.values[parameter.key]), color=_BEST, linewidth=1.2)
        if start is not None:
            axes.axvline(start, color=INK, linestyle=DASHED, linewidth=1.0)
        axes.set_ylim(-0.1 * top - 1e-9, 1.1 * top + 1e-9)
        axes.set_ylabel("worse by, %" if relative else "log-likelihood lost")
        axes.set_xlabel(shortened_to_width(parameter.key, _WIDTH))

    return Figure(
        f"{name}trials-{parameter.key.replace('.', '-').replace('_', '-')}",
        parameter.key,
        "How much worse each trial is than the tuned values; trials differ in other options too.",
        f"The trials over {parameter.key}",
        paint,
        _HEIGHT,
        legend=tuple(legend if start is not None else legend[:2]),
    )

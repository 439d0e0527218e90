"""Colours and ellipses that all figures of findings share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator

from trackbench.base.types import Array
from trackbench.document.drawing import MUTED, fit_value_axis
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.metrics.consistency import point95

TRACKER, REFERENCE = TRACKER_COLOURS[4], TRACKER_COLOURS[5]
COLOURS = {"tracker": TRACKER, "right": REFERENCE, "before": MUTED}
#: Size of an ellipse with 95 % of a Gaussian in a plane, standard deviations.
SIZE = float(np.sqrt(point95(2)))
_POINTS = 73
#: An axis that spans more than this factor has room for powers of ten alone.
_MANY = 3e3


def outline(mean: Array, covariance: Array, size: float = SIZE) -> Array:
    """``(2, k)`` points of an ellipse of ``size`` standard deviations; none of an indefinite covariance."""
    if not np.isfinite(covariance).all():
        return np.empty((2, 0))
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if values[0] < 0.0:
        return np.empty((2, 0))
    angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    return np.asarray(mean[:, None] + size * (vectors * np.sqrt(values)) @ np.array([np.cos(angle), np.sin(angle)]))


def fit_values(axes: Axes, drawn: Sequence[Array]) -> bool:
    """As :func:`fit_value_axis`, with room between the numbers also of many powers of ten."""
    logarithmic = fit_value_axis(axes, drawn)
    low, high = axes.get_ylim()
    if logarithmic and high > _MANY * low:
        axes.yaxis.set_major_locator(LogLocator(numticks=7))
    return logarithmic


def fit_equal(axes: Axes, drawn: list[Array]) -> None:
    """Equal scales and limits around all points ``(2, k)``, in as much of the box as there is."""
    points = np.concatenate(drawn, axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    if points.size:
        low, high = points.min(axis=1), points.max(axis=1)
        half = 0.55 * max(float((high - low).max()), 1e-9)
        middle = (low + high) / 2
        axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axes.set_aspect("equal", adjustable="box")

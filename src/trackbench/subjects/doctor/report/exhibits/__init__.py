"""The figure of a finding: one kind for each kind of exhibit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trackbench.document import Figure
from trackbench.subjects.doctor.exhibits import Covariances, Exhibit, Matrices, OverTime, Points, Predictions
from trackbench.subjects.doctor.report.exhibits.planes import covariances_figure, points_figure, predictions_figure
from trackbench.subjects.doctor.report.exhibits.values import matrices_figure, over_time_figure

__all__ = ["exhibit_figure"]

_DRAWN: dict[type[Exhibit], Callable[[str, Any], Figure]] = {
    Matrices: matrices_figure,
    Predictions: predictions_figure,
    Covariances: covariances_figure,
    OverTime: over_time_figure,
    Points: points_figure,
}


def exhibit_figure(name: str, exhibit: Exhibit) -> Figure:
    """The figure of an exhibit; ``name`` is that of its file."""
    return _DRAWN[type(exhibit)](name, exhibit)

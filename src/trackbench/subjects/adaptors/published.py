"""The names under which scenarios know the adaptors; the libraries are imported when a tracker starts, not before."""

from __future__ import annotations

from typing import Any

from trackbench.subjects.adaptors.options import FilterPyOptions, StoneSoupOptions
from trackbench.trackers.answers import Tracker


def filterpy(**options: Any) -> Tracker:
    """A KalmanFilter, ExtendedKalmanFilter or UnscentedKalmanFilter of FilterPy; needs trackbench[filterpy]."""
    from trackbench.subjects.adaptors.filterpy_tracker import build_filterpy

    return build_filterpy(options)


def stonesoup(**options: Any) -> Tracker:
    """A Kalman predictor and updater of Stone Soup; needs trackbench[stonesoup]."""
    from trackbench.subjects.adaptors.stonesoup_tracker import build_stonesoup

    return build_stonesoup(options)


# By these a scenario is checked before a tracker starts.
filterpy.Options = FilterPyOptions  # type: ignore[attr-defined]
stonesoup.Options = StoneSoupOptions  # type: ignore[attr-defined]

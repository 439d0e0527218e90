"""The names under which scenarios know the adaptors; the libraries are imported when a tracker starts, not before."""

from __future__ import annotations

import importlib
from typing import Any

from trackbench.errors import InputError
from trackbench.trackers.base import Tracker


def filterpy(**options: Any) -> Tracker:
    """A KalmanFilter, ExtendedKalmanFilter or UnscentedKalmanFilter of FilterPy; needs trackbench[filterpy]."""
    _require("filterpy", "FilterPy")
    from trackbench.adaptors.filterpy_filters import tracker

    return tracker(options)


def stonesoup(**options: Any) -> Tracker:
    """A Kalman predictor and updater of Stone Soup; needs trackbench[stonesoup]."""
    _require("stonesoup", "Stone Soup")
    from trackbench.adaptors.stonesoup_tracker import tracker

    return tracker(options)


def _require(package: str, name: str) -> None:
    try:
        importlib.import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        raise InputError(f'{name} is not installed: pip install "trackbench[{package}]"') from None

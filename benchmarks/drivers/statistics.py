"""What is compared of drivers, by the same smoothing of recorded and simulated ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from trackbench.base.types import Array

from .recorded import DT, SAME_LANE_M, Window

#: A polynomial of second order over so many samples: 2.1 s.
SMOOTHED_OVER = 21
#: Samples at either end of a window that have no neighbours on one side. They are left out: the error of a slope
#: there is several times as large.
END = SMOOTHED_OVER // 2
#: Accelerations below are as good as none, m/s^2.
SMALL_MPS2 = 0.1

#: By key: what it is called, with its unit.
NAMES = {
    "speed": "median speed, m/s",
    "rms": "acceleration, RMS, m/s²",
    "median": "its absolute value: median",
    "p90": "90 % point",
    "p99": "99 % point",
    "small": "share below 0.1 m/s²",
    "time": "autocorrelation time, s",
    "side": "lateral deviation, RMS, m",
    "side_speed": "lateral speed, RMS, m/s",
}


def acceleration(window: Window) -> Array:
    """Slope of the smoothed speed away from the ends of the window, m/s^2."""
    return np.asarray(savgol_filter(window.speed, SMOOTHED_OVER, 2, deriv=1, delta=DT))[END:-END]


def of(windows: Sequence[Window]) -> dict[str, float]:
    """The statistics of ``NAMES``."""
    series = [acceleration(window) for window in windows]
    size = np.abs(np.concatenate(series))
    median, p90, p99 = np.percentile(size, [50, 90, 99])
    sides = [savgol_filter(w.side, SMOOTHED_OVER, 2)[END:-END] for w in windows if w.side is not None]
    sides = [side for side in sides if np.ptp(side) < SAME_LANE_M]
    return {
        "speed": float(np.median(np.concatenate([window.speed for window in windows]))),
        "rms": float(np.sqrt(np.mean(size**2))),
        "median": float(median),
        "p90": float(p90),
        "p99": float(p99),
        "small": float(np.mean(size < SMALL_MPS2)),
        "time": correlation_time(series),
        "side": _rms([_off_the_line(side) for side in sides]),
        "side_speed": _rms([np.diff(side) / DT for side in sides]),
    }


def correlation_time(series: Sequence[Array]) -> float:
    """First lag at which the autocorrelation, pooled over all series, falls to 1/e, s."""
    before = 1.0
    for lag in range(1, 80):
        now = autocorrelation(series, lag)
        if now < np.exp(-1):
            return float(DT * (lag - 1 + (before - np.exp(-1)) / (before - now)))
        before = now
    return float("nan")


def autocorrelation(series: Sequence[Array], lag: int) -> float:
    """Of all series together, about a mean of zero."""
    pairs = [(a[: len(a) - lag], a[lag:]) for a in series if len(a) > lag]
    return sum(float(a @ b) for a, b in pairs) / max(1e-12, sum(float(a @ a) for a, _ in pairs))


def _off_the_line(side: Array) -> Array:
    """Distance from a straight line, since lanes are not exactly along x."""
    k = np.arange(len(side))
    return np.asarray(side - np.polyval(np.polyfit(k, side, 1), k))


def _rms(series: Sequence[Any]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(series) ** 2)))

"""The reference where it is a bound: the Kalman filter reaches it"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import trackbench as tb
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.types import Array

from .claim import Claim, rate

WHITE = {"motion": "cv", "acceleration_sigma_mps2": 2.0}
SCENE = {
    "name": "white",
    "truth": {
        "source": "scripted",
        "duration_s": 10,
        "rate_hz": 10,
        "objects": {
            "ahead": {"start": {"x": 60, "speed_mps": 5, "course_deg": 90}, "pieces": [{"white": WHITE}]},
            "left": {"start": {"x": -20, "y": 60, "speed_mps": 10}, "pieces": [{"white": WHITE}]},
        },
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15}},
    "trackers": {
        "from_truth": {
            **WHITE,
            "filter": "kf",
            "initial": {"from": "truth", "position_sigma_m": 1, "velocity_sigma_mps": 5},
        },
        # The RMS of 5 and 10 m/s, per axis.
        "from_first_reading": {
            **WHITE,
            "filter": "kf",
            "initial": {"from": "first_reading", "velocity_sigma_mps": float(np.sqrt((5**2 + 10**2) / 2 / 2))},
        },
    },
}
DETECTION = "sensors.lidar.detection_probability"
#: What is changed, and the runs that a Monte-Carlo error of about 0.004 takes.
CASES: dict[str, tuple[dict[str, Any], int]] = {
    "every detection": ({}, 5_000),
    "Pd 0.9": ({DETECTION: 0.9}, 5_000),
    "Pd 0.5": ({DETECTION: 0.5}, 40_000),
    "Pd 0.2": ({DETECTION: 0.2}, 80_000),
    "dropouts of 2 s and 0.6 s": (
        {"sensors.lidar.dropouts": [{"from_s": 3, "to_s": 5}, {"from_s": 7, "to_s": 7.6}]},
        40_000,
    ),
    "tracks of 0.5 s": ({"truth.duration_s": 0.5}, 20_000),
    "tracks of 0.5 s, Pd 0.2": ({"truth.duration_s": 0.5, DETECTION: 0.2}, 80_000),
}
FEW, MANY = 5, 100


def claims() -> Iterator[Claim]:
    """Vehicles with white acceleration, which the filter knows: its RMSE is that of the bound."""
    for label, (changes, runs) in CASES.items():
        result = tb.run(tb.load(SCENE, changes, runs=runs, seed=1))
        for name in ("from_truth", "from_first_reading"):
            for quantity in ("position", "velocity"):
                found = result[name].metrics[f"{quantity}_over_reference"]
                assert found.value is not None
                assert found.ci95 is not None
                yield Claim(
                    f"{quantity} RMSE over the bound, {label}, {name}, {runs:,} runs",
                    f"{found.value:.4f} ± {(found.ci95[1] - found.ci95[0]) / 2:.4f}",
                    "1.00 ± 0.01",
                    abs(found.value - 1.0) <= 0.01,
                )
        if label == "Pd 0.5":
            yield from _of_groups(result)


def _of_groups(result: tb.Result) -> Iterator[Claim]:
    """What few runs say, and how often the interval of many holds the truth, which is 1."""
    rows = result.to_pandas("runs").query("tracker == 'from_truth'")
    for quantity, unit in (("position", "m"), ("velocity", "mps")):
        sums = _sums(rows, quantity, unit)
        few = np.square([_over(group).value for group in _groups(sums, FEW)])
        error = 1.96 * few.std() / np.sqrt(len(few))
        yield Claim(
            f"mean over {len(few):,} groups of {FEW} runs of the square of the {quantity} RMSE over the bound, Pd 0.5",
            f"{few.mean():.4f} ± {error:.4f}",
            "1.00 ± 0.01",
            abs(float(few.mean()) - 1.0) <= 0.01,
        )
        intervals = [_over(group).ci95 for group in _groups(sums, MANY)]
        held = [interval is not None and interval[0] <= 1.0 <= interval[1] for interval in intervals]
        yield rate(
            f"95 % interval of the {quantity} RMSE over the bound holds 1, {MANY} runs, Pd 0.5", held, 0.93, 0.97
        )


def _sums(rows: Any, quantity: str, unit: str) -> Array:
    """``(2, runs)`` sums of the squared errors and of their bounds; a run without a detection has none."""
    columns = (f"{quantity}_rmse_{unit}", f"{quantity}_reference_{unit}")
    return np.nan_to_num(np.array([rows[column] ** 2 * rows["count"] for column in columns]))


def _groups(sums: Array, size: int) -> Array:
    """``(groups, 2, size)``"""
    groups = sums.shape[1] // size
    return sums[:, : groups * size].reshape(2, groups, size).swapaxes(0, 1)


def _over(sums: Array) -> Interval:
    return root(ratio(*sums))

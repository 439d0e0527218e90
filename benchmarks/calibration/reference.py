"""The reference where it is a bound: the Kalman filter reaches it"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import trackbench as tb
from trackbench.base.types import Array
from trackbench.metrics.intervals import Interval, ratio, root

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
            "initial": {"from": "first_measurement", "velocity_sigma_mps": float(np.sqrt((5**2 + 10**2) / 2 / 2))},
        },
    },
}
DETECTION = "sensors.lidar.detection_probability"
#: What is changed, and how many times ``RUNS`` runs a Monte-Carlo error of half of the room takes.
CASES: dict[str, tuple[dict[str, Any], int]] = {
    "every detection": ({}, 1),
    "Pd 0.9": ({DETECTION: 0.9}, 1),
    "Pd 0.5": ({DETECTION: 0.5}, 8),
    "Pd 0.2": ({DETECTION: 0.2}, 16),
    "dropouts of 2 s and 0.6 s": (
        {"sensors.lidar.dropouts": [{"from_s": 3, "to_s": 5}, {"from_s": 7, "to_s": 7.6}]},
        4,
    ),
    "tracks of 0.5 s": ({"truth.duration_s": 0.5}, 4),
    "tracks of 0.5 s, Pd 0.2": ({"truth.duration_s": 0.5, DETECTION: 0.2}, 16),
}
#: Each with motion of its own, which is kept for all of them at once.
RUNS = 5000
FEW, MANY = 5, 100


def claims() -> Iterator[Claim]:
    """Vehicles with white acceleration, which the filter knows: its RMSE is that of the bound."""
    for label, (changes, times) in CASES.items():
        results = [tb.run(tb.load(SCENE, changes, runs=RUNS, seed=seed)) for seed in range(times)]
        for tracker in ("from_truth", "from_first_reading"):
            for quantity, unit in (("position", "m"), ("velocity", "mps")):
                sums = np.concatenate([_sums(result, tracker, quantity, unit) for result in results], axis=1)
                found = _over(sums)
                assert found.ci95 is not None
                yield _one(
                    f"{quantity} RMSE over the bound, {label}, {tracker}, {sums.shape[1]:,} runs",
                    found.value,
                    (found.ci95[1] - found.ci95[0]) / 2,
                )
                if label == "Pd 0.5" and tracker == "from_truth":
                    yield _of_few(quantity, sums)
    yield from _intervals()


def _of_few(quantity: str, sums: Array) -> Claim:
    """What few runs say: the square is not biased, however few they are."""
    few = np.square([_over(group).value for group in _groups(sums, FEW)])
    return _one(
        f"mean over {len(few):,} groups of {FEW} runs of the square of the {quantity} RMSE over the bound, Pd 0.5",
        float(few.mean()),
        float(1.96 * few.std() / np.sqrt(len(few))),
    )


def _intervals() -> Iterator[Claim]:
    """How often the interval of many runs holds the truth, which is 1."""
    results = [
        tb.run(tb.load(SCENE, {DETECTION: 0.5}, runs=RUNS, seed=seed, trackers=["from_truth"])) for seed in range(24)
    ]
    for quantity, unit in (("position", "m"), ("velocity", "mps")):
        sums = np.concatenate([_sums(result, "from_truth", quantity, unit) for result in results], axis=1)
        intervals = [_over(group).ci95 for group in _groups(sums, MANY)]
        held = [interval is not None and interval[0] <= 1.0 <= interval[1] for interval in intervals]
        what = f"95 % interval of the {quantity} RMSE over the bound holds 1, {MANY} runs, Pd 0.5"
        yield rate(what, held, 0.93, 0.97)


def _one(what: str, value: float, error: float) -> Claim:
    return Claim(
        what,
        f"{value:.4f} ± {error:.4f}",
        "1.00 ± 0.01",
        abs(value - 1.0) <= 0.01,
        abs(abs(value - 1.0) - 0.01) > error,
        abs(value - 1.0) - 0.01,
    )


def _sums(result: tb.Result, tracker: str, quantity: str, unit: str) -> Array:
    """``(2, runs)`` sums of the squared errors and of their bounds; a run without a detection has none."""
    rows = result.to_pandas("runs")
    rows = rows[rows["tracker"] == tracker]
    columns = (f"{quantity}_rmse_{unit}", f"{quantity}_reference_{unit}")
    return np.asarray(np.nan_to_num([rows[column] ** 2 * rows["count"] for column in columns]))


def _groups(sums: Array, size: int) -> Array:
    """``(groups, 2, size)``"""
    groups = sums.shape[1] // size
    return sums[:, : groups * size].reshape(2, groups, size).swapaxes(0, 1)


def _over(sums: Array) -> Interval:
    return root(ratio(*sums))

"""Conversion of beliefs, scans and predicted measurements to named arrays, and back."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from typing import Any

import numpy as np

from trackbench.base.types import Scan
from trackbench.engine.equations import Values
from trackbench.filters import AnyBelief, Belief, MultiModelBelief, PredictedMeasurement

#: Parts of a belief that a filter can recompute from the other parts.
REUSED = ("factor", "points")
#: Number of component axes of each array, by its name without the number of a mode.
RANKS = {
    "mean": 1,
    "covariance": 2,
    "factor": 2,
    "points": 2,
    "probability": 1,
    "repaired": 0,
    "expected": 1,
    "spread": 2,
    "cross": 2,
    "measurement": 1,
    "valid": 0,
    "noise": 2,
    "pose": 1,
    "velocity": 1,
    "dt": 0,
    "chain": 2,
    "share": 0,
    "kept": 0,
}


def component_axes(name: str) -> int:
    """Return how many component axes, before the batch axes, an array with this name has."""
    return RANKS[name.partition(" ")[0]]


def belief_values(belief: AnyBelief, at: str = "", without: Collection[str] = ()) -> dict[str, Any]:
    """Return the arrays of a belief by name; ``at`` is appended to each name, and names in ``without`` are left out."""
    result: dict[str, Any]
    if isinstance(belief, MultiModelBelief):
        result = {"probability" + at: belief.probability}
        for number, mode in enumerate(belief.modes):
            result |= belief_values(mode, f"{at} {number}", without)
        if belief.repaired is not None:
            result["repaired" + at] = belief.repaired
        return result
    result = {}
    for name, value in zip(Belief._fields, belief, strict=True):
        if value is not None and name not in without:
            result[name + at] = value
    return result


def belief_of(values: Values, modes: int, at: str = "") -> AnyBelief:
    """Build a belief from named arrays; ``modes`` is the number of its motion models, 0 for a belief without modes."""
    if modes:
        parts = [belief_of(values, 0, f"{at} {number}") for number in range(modes)]
        singles = tuple(part for part in parts if isinstance(part, Belief))
        return MultiModelBelief(values["probability" + at], singles, values.get("repaired" + at))
    arrays: Any = map(values.get, _belief_names(at))
    return Belief(*arrays)


@cache
def _belief_names(at: str) -> list[str]:
    return [name + at for name in Belief._fields]


def prediction_values(predicted: PredictedMeasurement, at: str = "") -> dict[str, Any]:
    """Return the arrays of a predicted measurement by name; ``at`` is appended to each name."""
    result = {"expected" + at: predicted.mean, "spread" + at: predicted.covariance, "cross" + at: predicted.cross}
    for number, mode in enumerate(predicted.modes):
        result |= prediction_values(mode, f"{at} {number}")
    return result


def prediction_of(values: Values, modes: int, at: str = "") -> PredictedMeasurement:
    """Build a predicted measurement from named arrays; ``modes`` is as in :func:`belief_of`."""
    parts = tuple([prediction_of(values, 0, f"{at} {number}") for number in range(modes)]) if modes else ()
    return PredictedMeasurement(values["expected" + at], values["spread" + at], values["cross" + at], parts)


def scan_values(scan: Scan) -> dict[str, Any]:
    """Return the arrays of a scan, with its measurements, by name."""
    noise, pose, velocity = scan.noise_covariance, scan.sensor_pose, scan.sensor_velocity
    return {"measurement": scan.measurement, "valid": scan.valid, "noise": noise, "pose": pose, "velocity": velocity}


def sensor_values(scan: Scan) -> dict[str, Any]:
    """Return the arrays by name that describe a scan's sensor, without the measurements."""
    return {"noise": scan.noise_covariance, "pose": scan.sensor_pose, "velocity": scan.sensor_velocity}


def any_scan(values: Values, scan: Scan) -> Scan:
    """Return ``scan`` with the named arrays that describe its sensor, and a meaningless measurement."""
    measurement = np.zeros(len(values["noise"]))
    return scan_of({**values, "measurement": measurement, "valid": np.ones((), dtype=bool)}, scan)


def scan_of(values: Values, scan: Scan) -> Scan:
    """Return ``scan`` with its arrays replaced by the named arrays."""
    return scan._replace(
        measurement=values["measurement"],
        valid=values["valid"],
        noise_covariance=values["noise"],
        sensor_pose=values["pose"],
        sensor_velocity=values["velocity"],
    )


def scan_placeholder(kind: str, sensor: str | None) -> Scan:
    """Return a scan with only a type of sensor, and the sensor's name if given, so that equations use nothing else."""
    known = {"kind": kind, "sensor": sensor}
    fields: list[Any] = [known.get(name) for name in Scan._fields]
    return Scan(*fields)

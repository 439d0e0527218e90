"""What filters believe and are told, as named arrays, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.engine.equations import Values
from trackbench.filters import AnyBelief, Belief, MultiModelBelief, PredictedMeasurement
from trackbench.types import Scan

#: Number of component axes of each part, by the name without the number of a mode.
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


def rank(name: str) -> int:
    """Number of component axes of a named array; of options that are stated in numbers, see ``options``."""
    return RANKS[name.partition(" ")[0]]


def taken_apart(belief: AnyBelief, at: str = "") -> dict[str, Any]:
    """The arrays of a belief; ``at`` is put behind each name."""
    if isinstance(belief, MultiModelBelief):
        found: dict[str, Any] = {"probability" + at: belief.probability}
        for number, mode in enumerate(belief.modes):
            found |= taken_apart(mode, f"{at} {number}")
        if belief.repaired is not None:
            found["repaired" + at] = belief.repaired
        return found
    return {name + at: value for name, value in belief._asdict().items() if value is not None}


def put_together(values: Values, modes: int, at: str = "") -> AnyBelief:
    """The belief of arrays; ``modes``: how many it has, 0 where it is of one motion model."""
    if modes:
        parts = [put_together(values, 0, f"{at} {number}") for number in range(modes)]
        singles = tuple(part for part in parts if isinstance(part, Belief))
        return MultiModelBelief(values["probability" + at], singles, values.get("repaired" + at))
    return Belief(**{name: values[name + at] for name in Belief._fields if name + at in values})


def of_prediction(predicted: PredictedMeasurement, at: str = "") -> dict[str, Any]:
    """The arrays of a predicted measurement."""
    found = {"expected" + at: predicted.mean, "spread" + at: predicted.covariance, "cross" + at: predicted.cross}
    for number, mode in enumerate(predicted.modes):
        found |= of_prediction(mode, f"{at} {number}")
    return found


def prediction_of(values: Values, modes: int, at: str = "") -> PredictedMeasurement:
    """The predicted measurement of arrays."""
    parts = tuple(prediction_of(values, 0, f"{at} {number}") for number in range(modes))
    return PredictedMeasurement(values["expected" + at], values["spread" + at], values["cross" + at], parts)


def of_scan(scan: Scan) -> dict[str, Any]:
    """What equations know of a scan."""
    return {"measurement": scan.measurement, "valid": scan.valid, **of_sensor(scan)}


def of_sensor(scan: Scan) -> dict[str, Any]:
    """What equations that do not look at the measurements know of a scan."""
    return {"noise": scan.noise_covariance, "pose": scan.sensor_pose, "velocity": scan.sensor_velocity}


def any_scan(values: Values, kind: str) -> Scan:
    """A scan of a sensor, with a measurement that means nothing."""
    measurement = np.zeros(len(values["noise"]))
    return scan_of({**values, "measurement": measurement, "valid": np.ones((), dtype=bool)}, kind)


def scan_of(values: Values, kind: str) -> Scan:
    """A scan of arrays; what else there is of a scan is missing, so that a sensor that needs it cannot be traced."""
    missing: Any = None
    return Scan(
        time=missing,
        sensor=missing,
        kind=kind,
        measurement=values["measurement"],
        valid=values["valid"],
        noise_covariance=values["noise"],
        sensor_pose=values["pose"],
        sensor_velocity=values["velocity"],
        arrival_time=missing,
    )

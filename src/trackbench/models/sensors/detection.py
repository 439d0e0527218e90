"""What a sensor detects, misses, merges and makes up: options of every sensor, each off unless stated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import Config, NonNegative, Positive, Probability, Problem
from trackbench.base.types import Array

#: Probability of a false alarm in a cell of the radar, to which ``half_range_m`` refers.
FALSE_ALARM_PROBABILITY = 1e-6

Point = Annotated[list[float], Field(min_length=2, max_length=2)]
Interval = Annotated[list[float], Field(min_length=2, max_length=2)]


def signal_ratio(distance: Array, half_range_m: float) -> Array:
    """``(...)`` mean signal-to-noise ratio at distances in m: by the radar equation, and such that half of the targets
    at ``half_range_m`` are detected.

    Source: Swerling (1954), "Probability of detection for fluctuating targets", case 1, where
    ``P = P_fa^(1 / (1 + S))``, with the signal-to-noise ratio S proportional to ``range^-4``.
    """
    at_half = np.log(FALSE_ALARM_PROBABILITY) / np.log(0.5) - 1.0
    return np.asarray(at_half * (half_range_m / distance) ** 4)


def detected_share(distance: Array, half_range_m: float) -> Array:
    """``(...)`` share of the targets at distances in m that are detected at that ratio."""
    return np.asarray(FALSE_ALARM_PROBABILITY ** (1.0 / (1.0 + signal_ratio(distance, half_range_m))))


class DetectionFactors(Config):
    """Factors of the detection probability."""

    half_range_m: Positive | None = Field(
        None,
        description="Range at which a radar detects a fluctuating target (Swerling 1, false alarm probability 1e-6) "
        "with probability 0.5, m; the curve follows from the radar equation.",
    )


class ClutterPlace(Config):
    """A thing at rest that causes false alarms, such as a guard rail."""

    line: list[Point] = Field(min_length=1, description="Its corners [x, y], m; a single one is a point.")
    frame: Literal["fixed", "observer"] = Field(
        "fixed",
        description="fixed: the frame of the world. observer: x forward of the observer and y to its left, for what "
        "runs along the road.",
    )
    per_scan: Positive = Field(
        le=1000, description="Mean number of false alarms per scan from all of it; those out of view are not detected."
    )
    spread_m: NonNegative = Field(
        0, description="Standard deviation of the place along each axis, m, beside the sensor's noise."
    )


class Clutter(Config):
    """False alarms: detections that stem from no vehicle. Their numbers are Poisson distributed."""

    per_scan: float = Field(
        0,
        ge=0,
        le=1000,
        description="Mean number per scan of those that are uniform in the field of view: of a radar in range, azimuth "
        "and range rate, of a lidar in x and y.",
    )
    range_rate_mps: Interval = Field(
        default_factory=lambda: [-50.0, 50.0], description="A radar's interval of range rate, m/s."
    )
    places: list[ClutterPlace] = Field(default_factory=list, description="Things at rest that cause more of them.")

    def problems(self) -> Iterator[Problem]:
        low, high = self.range_rate_mps
        if low >= high:
            yield Problem(("range_rate_mps",), f"must be [low, high] with {low:g} below {high:g}")


class Resolution(Config):
    """The cell in which two vehicles give one measurement. A quantity without a size does not tell them apart."""

    range_m: Positive | None = Field(None, description="Size in range, m.")
    azimuth_deg: Positive | None = Field(None, description="Size in azimuth, degrees.")
    range_rate_mps: Positive | None = Field(None, description="Size in range rate, m/s; not of a lidar.")

    def problems(self) -> Iterator[Problem]:
        if not self.model_fields_set:
            yield Problem((), "says nothing: add range_m, azimuth_deg or range_rate_mps")


class StatedDetection(Config):
    """What the sensor tells trackers where that is not what is simulated."""

    detection_probability: Probability | None = Field(
        None, description="Of a vehicle in the field of view; the sensor's detection_probability unless given."
    )
    half_range_m: Positive | None = Field(
        None,
        description="Range at which half of these vehicles are detected, m: the probability falls with the range by "
        "the curve of detection.half_range_m. It is the same at all ranges unless given.",
    )
    clutter_per_scan: NonNegative | None = Field(
        None, description="Mean number of false alarms per scan, uniform in view; clutter.per_scan unless given."
    )

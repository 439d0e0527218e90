"""Options on detections, misses, false alarms and merged measurements, for every sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import Config, NonNegative, Positive, Probability, Problem
from trackbench.base.types import Array

#: Probability of a false alarm in a radar cell, at which ``half_range_m`` holds.
FALSE_ALARM_PROBABILITY = 1e-6

Point = Annotated[list[float], Field(min_length=2, max_length=2)]
Interval = Annotated[list[float], Field(min_length=2, max_length=2)]


def signal_ratio(distance: Array, half_range_m: float) -> Array:
    """Compute the mean signal-to-noise ratios ``(...)`` of targets at distances in m, by the radar equation.

    Half of the targets at ``half_range_m`` are detected. Source: Swerling (1954), "Probability of detection for
    fluctuating targets", case 1: ``P = P_fa^(1 / (1 + S))``, with the signal-to-noise ratio S proportional to
    ``range^-4``.
    """
    at_half = np.log(FALSE_ALARM_PROBABILITY) / np.log(0.5) - 1.0
    return np.asarray(at_half * (half_range_m / distance) ** 4)


def detected_share(distance: Array, half_range_m: float) -> Array:
    """Compute the P_D ``(...)`` of Swerling 1 targets at distances in m, which is 0.5 at ``half_range_m``."""
    return np.asarray(FALSE_ALARM_PROBABILITY ** (1.0 / (1.0 + signal_ratio(distance, half_range_m))))


class DetectionFactors(Config):
    """Dependence of a sensor's detection probability on the range."""

    half_range_m: Positive | None = Field(
        None,
        description="Range at which a radar detects a fluctuating target (Swerling 1, false alarm probability 1e-6) "
        "with probability 0.5, m; the curve follows from the radar equation.",
    )


class ClutterPlace(Config):
    """Object at rest that causes false alarms, such as a guard rail."""

    line: list[Point] = Field(min_length=1, description="Corners [x, y], m; a single corner is a point.")
    frame: Literal["fixed", "observer"] = Field(
        "fixed",
        description="fixed: the frame of the world. observer: x forward of the observer and y to its left, for an "
        "object along the road.",
    )
    per_scan: Positive = Field(
        le=1000, description="Mean number of false alarms per scan, in view or not; only those in view are detected."
    )
    spread_m: NonNegative = Field(
        0, description="Standard deviation of the place along each axis, m, in addition to the sensor's noise."
    )


class Clutter(Config):
    """False alarms: detections that no vehicle causes. Their number is Poisson distributed."""

    per_scan: float = Field(
        0,
        ge=0,
        le=1000,
        description="Mean number per scan of false alarms uniform in the field of view: for a radar in range, azimuth "
        "and range rate, for a lidar in x and y.",
    )
    range_rate_mps: Interval = Field(
        default_factory=lambda: [-50.0, 50.0], description="Interval of a radar's range rate, m/s."
    )
    places: list[ClutterPlace] = Field(default_factory=list, description="Objects at rest that cause false alarms.")

    def problems(self) -> Iterator[Problem]:
        low, high = self.range_rate_mps
        if low >= high:
            yield Problem(("range_rate_mps",), f"must be [low, high] with {low:g} below {high:g}")


class Resolution(Config):
    """Cell in which two vehicles give one measurement; a component whose size is left out does not separate them."""

    range_m: Positive | None = Field(None, description="Size in range, m.")
    azimuth_deg: Positive | None = Field(None, description="Size in azimuth, degrees.")
    range_rate_mps: Positive | None = Field(None, description="Size in range rate, m/s; not for a lidar.")

    def problems(self) -> Iterator[Problem]:
        if not self.model_fields_set:
            yield Problem((), "is empty: add range_m, azimuth_deg or range_rate_mps")


class StatedDetection(Config):
    """Detection probability and clutter that the sensor states to trackers, in place of the simulated values."""

    detection_probability: Probability | None = Field(
        None, description="P_D of a vehicle in the field of view; default: detection_probability of the sensor."
    )
    half_range_m: Positive | None = Field(
        None,
        description="Range at which P_D is half of the stated detection probability, m; P_D falls with the range by "
        "the curve of detection.half_range_m. Default: the same P_D at all ranges.",
    )
    clutter_per_scan: NonNegative | None = Field(
        None, description="Mean number of false alarms per scan, uniform in view; default: clutter.per_scan."
    )

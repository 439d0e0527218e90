"""Signal-to-noise ratio: how well and how surely a radar detects what it sees."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from trackbench.base.config import Config, Positive, Problem
from trackbench.base.scipy_functions import scipy_function
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects.base import Effect, Sensed

#: Received power, relative to the noise, above which a vehicle is detected.
THRESHOLD = -np.log(FALSE_ALARM_PROBABILITY)


class SignalRange(Config):
    """How the noise of a radar depends on the range by way of its signal-to-noise ratio."""

    half_range_m: Positive = Field(
        description="Range at which half of the vehicles that show their front or rear are detected, m."
    )
    stated_at_m: Positive = Field(
        description="Range at which the sensor's standard deviations are those at the mean power, m."
    )
    constant_share: float = Field(
        0, ge=0, le=1, description="Share of the noise variance that does not depend on the signal."
    )

    def ratio(self, distance: Array) -> Array:
        """``(...)`` mean signal-to-noise ratio of a front or rear at distances in m."""
        return signal_ratio(distance, self.half_range_m)

    def variance_factor(self, power: Array) -> Array:
        """``(...)`` variance of the noise over that of the sensor's options, for a received power."""
        relative = (1.0 + self.ratio(np.array(self.stated_at_m))) / power
        return self.constant_share + (1.0 - self.constant_share) * relative

    def mean_variance_factor(self, distance: Array) -> Array:
        """``(...)`` the mean of that over all detections at distances in m.

        With the mean power m, the threshold T and x = T / m: ``E[1 / P | P > T] = exp(x) E1(x) / m``, P being
        exponential and E1 the exponential integral.
        """
        mean = 1.0 + self.ratio(distance)
        x = THRESHOLD / mean
        return self.variance_factor(mean / (np.exp(x) * scipy_function("scipy.special", "_ufuncs", "exp1")(x)))

    def problems(self) -> Iterator[Problem]:
        if self.stated_at_m > self.half_range_m:
            yield Problem(("stated_at_m",), f"must be at most half_range_m, which is {self.half_range_m:g}")


class SignalToNoise(SignalRange, Effect):
    """Detection and accuracy from one signal-to-noise ratio: of range, aspect and a cross-section that fluctuates.

    The received power P is drawn anew for each scan (Swerling 1). A vehicle is detected where it exceeds the threshold
    of a false alarm probability of 1e-6. The variances are those of the sensor's options times
    ``share + (1 - share) P0 / P`` with the mean power P0 at ``stated_at_m``.

    Source: Swerling (1954), "Probability of detection for fluctuating targets", case 1; Barton (2005), "Radar System
    Analysis and Modeling", section 8.1: the error of an estimate falls with the root of the ratio.
    """

    side_db: float = Field(
        0,
        ge=-40,
        le=40,
        description="Cross-section of a vehicle's side over that of its front or rear, dB; in between, the logarithm "
        "goes with the square of the sine of the aspect.",
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        ahead, left = sensed.bodies.seen_from(sensed.pose)
        distance = np.hypot(ahead, left)
        side = np.divide(left, distance, out=np.zeros_like(left), where=distance > 0) ** 2
        mean = 1.0 + self.ratio(distance) * 10.0 ** (self.side_db * side / 10.0)
        power = mean * random.standard_exponential(sensed.shape)
        detected = power > THRESHOLD
        factor = np.sqrt(self.variance_factor(np.where(detected, power, np.inf)))
        return sensed.replaced(probability=sensed.probability * detected, scale=sensed.scale * factor)

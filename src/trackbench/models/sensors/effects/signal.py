"""Detection and accuracy of a radar as functions of its signal-to-noise ratio."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import Field
from scipy.special import exp1

from trackbench.base.config import Config, Positive, Problem
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.models.sensors.detection import FALSE_ALARM_PROBABILITY, signal_ratio
from trackbench.models.sensors.effects.base import Effect, Sensed
from trackbench.models.sensors.effects.processes import smooth_process

#: Received power, relative to the noise, above which a vehicle is detected.
THRESHOLD = -np.log(FALSE_ALARM_PROBABILITY)
#: Speed of light, m/s.
LIGHT_MPS = 299_792_458.0


class SignalRange(Config):
    """Dependence of a radar's noise on the range through the signal-to-noise ratio."""

    half_range_m: Positive = Field(
        description="Range at which half of the vehicles that show their front or rear are detected, m."
    )
    stated_at_m: Positive = Field(
        description="Range at which the sensor's standard deviations hold for the mean power, m."
    )
    constant_share: float = Field(
        0, ge=0, le=1, description="Share of the noise variance that does not depend on the signal."
    )

    def ratio(self, distance: Array) -> Array:
        """Compute the mean signal-to-noise ratio ``(...)`` of a vehicle's front or rear at distances in m."""
        return signal_ratio(distance, self.half_range_m)

    def variance_factor(self, power: Array) -> Array:
        """Compute the factor ``(...)`` by which a received power changes the noise variance of the sensor's options."""
        relative = (1.0 + self.ratio(np.array(self.stated_at_m))) / power
        return self.constant_share + (1.0 - self.constant_share) * relative

    def mean_variance_factor(self, distance: Array) -> Array:
        """Average ``variance_factor`` over the detections of a vehicle's front or rear at distances in m."""
        return self.factor_at_mean(1.0 + self.ratio(distance))

    def factor_at_mean(self, mean: Array) -> Array:
        """Average ``variance_factor`` over detections whose received power has the mean ``mean`` ``(...)``.

        With the mean power m, the threshold T and x = T / m: ``E[1 / P | P > T] = exp(x) E1(x) / m``, P being
        exponential and E1 the exponential integral.
        """
        x = THRESHOLD / mean
        return self.variance_factor(mean / (np.exp(x) * exp1(x)))

    def problems(self) -> Iterator[Problem]:
        if self.stated_at_m > self.half_range_m:
            yield Problem(("stated_at_m",), f"must be at most half_range_m, which is {self.half_range_m:g}")


class SignalToNoise(SignalRange, Effect):
    """Detection and accuracy from one signal-to-noise ratio, which depends on range, aspect and a fluctuating echo."""

    side_db: float = Field(
        0,
        ge=-40,
        le=40,
        description="Cross-section of a vehicle's side relative to its front or rear, dB; in between, the logarithm "
        "goes with the square of the sine of the aspect.",
    )
    carrier_ghz: Positive = Field(
        77,
        description="Carrier frequency f, GHz. A change of the aspect by c / (2 L f) rad decorrelates the signal of a "
        "vehicle of extent L across the line of sight: 1.1 mrad of 1.8 m at 77 GHz.",
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        """Draw which vehicles are detected, and the variances of the noise in their measurements.

        The received power is ``P = |sqrt(S) s + n|^2``, relative to the noise. S is the mean signal-to-noise ratio, s
        the vehicle's reflection and n the receiver's noise, both complex Gaussian with power 1, so P is exponential
        (Swerling 1). A vehicle is detected where P exceeds the threshold of a false alarm probability of 1e-6.

        Each scan draws a new receiver noise. The reflection follows the aspect, the direction of the line of sight in
        the vehicle's frame, as a Gauss-Markov process of second order along the turn of the aspect. Its correlation is
        1/e after ``c / (2 L f)``, where L is the extent of the vehicle across the line of sight. (Scatterers spread
        evenly over L have a correlation of zero there, and 1/e at 0.7 of it.) Where an aspect returns or a vehicle was
        hidden, a new reflection is drawn.

        The variances of the white noise are those of the sensor's options times ``share + (1 - share) P0 / P``, with
        the mean power P0 at ``stated_at_m``. Slow errors have the mean of this factor over detections.

        Source: Swerling (1954), "Probability of detection for fluctuating targets", case 1; Richards (2014),
        "Fundamentals of Radar Signal Processing", equation 2.63, for the aspect that decorrelates; Barton (2005),
        "Radar System Analysis and Modeling", section 8.1: the error of an estimate falls with the root of the ratio.
        """
        ahead, left = sensed.bodies.seen_from(sensed.pose)
        distance = np.hypot(ahead, left)
        side = np.divide(left, distance, out=np.zeros_like(left), where=distance > 0)
        # A vehicle outside the scene has a distance of NaN.
        ratio = self.ratio(distance) * 10.0 ** (self.side_db * side**2 / 10.0)
        ratio = np.where(np.isnan(ratio), 0.0, ratio)
        across = sensed.bodies.length * np.abs(side) + sensed.bodies.width * np.sqrt(1.0 - side**2)
        rate = across * (2e9 * self.carrier_ghz / LIGHT_MPS)
        turned = np.abs(wrap_angle(np.diff(np.arctan2(left, ahead), axis=0))) * (rate[1:] + rate[:-1]) / 2.0
        instants, objects = sensed.shape
        white = random.standard_normal((instants, 4, objects))
        # A vehicle that comes into view has a new reflection.
        seen = sensed.visible[:-1] & np.isfinite(turned)
        power = received_power(ratio, np.where(seen, turned, np.inf), white)
        detected = power > THRESHOLD
        factor = np.sqrt(self.variance_factor(np.where(detected, power, np.inf)))
        return sensed.replaced(
            probability=sensed.probability * detected,
            scale=sensed.scale * factor,
            slow_scale=sensed.slow_scale * np.sqrt(self.factor_at_mean(1.0 + ratio)),
        )


def received_power(ratio: Array, turned: Array, white: Array) -> Array:
    """Draw the received powers, relative to the noise, of vehicles whose aspects change.

    Args:
        ratio: ``(instants, objects, runs or 1)`` mean signal-to-noise ratio.
        turned: ``(instants - 1, objects, runs or 1)`` change of the aspect, in multiples of the change that
            decorrelates it to 1/e, at least 0.
        white: ``(instants, 4, objects, runs)`` draws of a standard normal: two for the vehicle's reflection, two for
            the receiver's noise.

    Returns:
        powers ``(instants, objects, runs)``, exponentially distributed with mean ``1 + ratio``.
    """
    parts = np.sqrt(ratio)[:, None] * smooth_process(turned[:, None], white[:, :2]) + white[:, 2:]
    return np.asarray(0.5 * (parts**2).sum(axis=1))

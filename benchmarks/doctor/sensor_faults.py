"""Faults in the measurement model of a plain tracker, as methods that override the correct ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array


class BareResidual:
    def residual(self, kind: str, a: Array, b: Array) -> Array:
        return a - b


class BareInnovation:
    """Only the innovation; an unscented filter still wraps the spread of its points."""

    def innovation(self, scan: Any, predicted: Array) -> Array:
        return scan.measurement - predicted


class BareSpread:
    """The spread of an unscented filter's points about one of them, of which their mean is made, and about the mean."""

    def measurement_spread(self, kind: str, points: Array, centre: Array) -> Array:
        return points - centre


class BareCross:
    """The mean of an unscented filter's points, and their spread in the cross-covariance: the gain does not fit S."""

    def measurement_mean(self, kind: str, points: Array, weights: Array) -> Array:
        return weights @ points

    def cross_spread(self, kind: str, points: Array, centre: Array) -> Array:
        return points - centre


class BareMean:
    """Only the mean of an unscented filter's points."""

    def measurement_mean(self, kind: str, points: Array, weights: Array) -> Array:
        return weights @ points


class Arctan:
    def azimuth(self, x: float, y: float) -> float:
        with np.errstate(divide="ignore"):
            return np.arctan(np.divide(y, x))


class AzimuthInDegrees:
    def azimuth(self, x: float, y: float) -> float:
        return np.degrees(np.arctan2(y, x))


class RateNegated:
    """In the prediction; the Jacobian is right."""

    def range_rate(self, target: Array, scan: Any) -> float:
        return -super().range_rate(target, scan)


class SpeedOverGround:
    """Speed where the range rate belongs, consistently."""

    def range_rate(self, target: Array, scan: Any) -> float:
        return np.hypot(target[2], target[3])

    def sensor_jacobian(self, x: Array, scan: Any) -> Array:
        H = super().sensor_jacobian(x, scan)
        if scan.kind == "radar":
            H[2] = [0, 0, *x[2:] / max(np.hypot(x[2], x[3]), 1e-6)]
        return H


class RelativeSpeed:
    """Speed relative to the sensor where the range rate belongs, in the prediction; the Jacobian is right."""

    def range_rate(self, target: Array, scan: Any) -> float:
        return np.hypot(*(target[2:] - scan.sensor_velocity))

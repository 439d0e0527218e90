"""Filters: pure predict and update on a belief."""

from trackbench.filters.base import Belief, Filter, Measured, PredictedMeasurement, Update
from trackbench.filters.kalman import ExtendedKalmanFilter, IteratedExtendedKalmanFilter, KalmanFilter
from trackbench.filters.sigma_point import CUBATURE, SigmaPointFilter, SymmetricSet, classic, scaled

__all__ = [
    "CUBATURE",
    "Belief",
    "ExtendedKalmanFilter",
    "Filter",
    "IteratedExtendedKalmanFilter",
    "KalmanFilter",
    "Measured",
    "PredictedMeasurement",
    "SigmaPointFilter",
    "SymmetricSet",
    "Update",
    "classic",
    "scaled",
]

"""Filters: pure predict and update on a belief."""

from trackbench.filters.base import (
    AnyBelief,
    Belief,
    Filter,
    Measured,
    MultiModelBelief,
    PredictedMeasurement,
    SingleModelFilter,
    Step,
    StepGuard,
    Update,
)
from trackbench.filters.batches import bare, choose, concatenated, placed, select, selected_prediction
from trackbench.filters.imm import InteractingMultipleModel
from trackbench.filters.kalman import ExtendedKalmanFilter, IteratedExtendedKalmanFilter, KalmanFilter
from trackbench.filters.sigma_point import CUBATURE, SigmaPointFilter, SymmetricSet, classic, scaled
from trackbench.filters.smoothers import smoothed

__all__ = [
    "CUBATURE",
    "AnyBelief",
    "Belief",
    "ExtendedKalmanFilter",
    "Filter",
    "InteractingMultipleModel",
    "IteratedExtendedKalmanFilter",
    "KalmanFilter",
    "Measured",
    "MultiModelBelief",
    "PredictedMeasurement",
    "SigmaPointFilter",
    "SingleModelFilter",
    "Step",
    "StepGuard",
    "SymmetricSet",
    "Update",
    "bare",
    "choose",
    "classic",
    "concatenated",
    "placed",
    "scaled",
    "select",
    "selected_prediction",
    "smoothed",
]

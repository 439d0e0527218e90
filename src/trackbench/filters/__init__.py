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
    bare,
    choose,
    concatenated,
    select,
    selected_prediction,
    with_members,
)
from trackbench.filters.error_states import ErrorState, MotionWithErrors
from trackbench.filters.imm import InteractingMultipleModel
from trackbench.filters.kalman import (
    CUBATURE,
    ExtendedKalmanFilter,
    IteratedExtendedKalmanFilter,
    KalmanFilter,
    SigmaPointFilter,
    SymmetricSet,
)

__all__ = [
    "CUBATURE",
    "AnyBelief",
    "Belief",
    "ErrorState",
    "ExtendedKalmanFilter",
    "Filter",
    "InteractingMultipleModel",
    "IteratedExtendedKalmanFilter",
    "KalmanFilter",
    "Measured",
    "MotionWithErrors",
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
    "concatenated",
    "select",
    "selected_prediction",
    "with_members",
]

"""Filters: prediction, update and smoothing of a belief, without any state of the filter.

A belief and a time step or a scan come in; a new belief goes out, with the innovation after an update. Arrays have any
batch axes. Read ``base.py`` first.
"""

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
    choose,
    compact,
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
    "choose",
    "compact",
    "concatenated",
    "select",
    "selected_prediction",
    "with_members",
]

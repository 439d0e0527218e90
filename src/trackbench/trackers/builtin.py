"""The built-in filters as trackers, made from the keys that a scenario gives."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import create_model

from trackbench.filters import (
    CUBATURE,
    ExtendedKalmanFilter,
    Filter,
    InteractingMultipleModel,
    IteratedExtendedKalmanFilter,
    KalmanFilter,
    SigmaPointFilter,
    SingleModelFilter,
    classic,
    scaled,
)
from trackbench.models.motion import MotionModel
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.imm import ImmConfig

#: What each name stands for, as ``trackbench list filters`` shows it.
FILTERS = {
    "kf": "Kalman filter on positions (a radar measurement is converted, its range rate left out); motion cv or ca",
    "ekf": "extended Kalman filter of first order",
    "iekf": "iterated extended Kalman filter",
    "ukf": "unscented Kalman filter, scaled or classic sigma points, augmented or not",
    "ckf": "cubature Kalman filter of third degree",
}


def build(config: FilterConfig) -> FilterTracker:
    """The tracker that a scenario's ``filter:`` entry describes; its keys are the options of the functions below."""
    return FilterTracker(
        filter_of(config),
        config.initial,
        assumed=config.assumed,
        sensors=config.sensors,
        advance_at=config.advance_at,
        late=config.late,
        lag_s=config.lag_s,
    )


def kf(**options: Any) -> FilterTracker:
    """A Kalman filter on positions."""
    return build(FilterConfig(filter="kf", **options))


def ekf(**options: Any) -> FilterTracker:
    """An extended Kalman filter."""
    return build(FilterConfig(filter="ekf", **options))


def iekf(**options: Any) -> FilterTracker:
    """An iterated extended Kalman filter."""
    return build(FilterConfig(filter="iekf", **options))


def ukf(**options: Any) -> FilterTracker:
    """An unscented Kalman filter."""
    return build(FilterConfig(filter="ukf", **options))


def ckf(**options: Any) -> FilterTracker:
    """A cubature Kalman filter."""
    return build(FilterConfig(filter="ckf", **options))


for _factory in (kf, ekf, iekf, ukf, ckf):
    _name = _factory.__name__
    # Its options are the keys of a scenario's ``filter:`` entry, the filter itself given.
    _options: dict[str, Any] = {"filter": (Literal[_name], _name), "smoother": (None, None)}
    _factory.Options = create_model(_name, __base__=FilterConfig, **_options)  # type: ignore[attr-defined]


def filter_of(config: FilterConfig) -> Filter[Any]:
    """The filter that the keys describe."""
    filters = tuple(filter_with(config, motion) for motion in config.models)
    if not isinstance(config.motion, ImmConfig):
        return filters[0]
    return InteractingMultipleModel(filters, tuple(config.motion.stay_s), config.motion.first_probabilities)


def filter_with(config: FilterConfig, motion: MotionModel) -> SingleModelFilter:
    """The filter that the keys describe, with one motion model."""
    match config.filter:
        case "kf":
            return KalmanFilter(motion)
        case "ekf":
            return ExtendedKalmanFilter(motion)
        case "iekf":
            return IteratedExtendedKalmanFilter(motion, config.iterations)
        case "ckf":
            return SigmaPointFilter(motion, CUBATURE, augmented=False)
        case "ukf":
            if config.sigma_points == "classic":
                rule = classic(config.kappa)
            else:
                rule = scaled(config.alpha, config.beta, config.kappa or 0.0)
            return SigmaPointFilter(motion, rule, config.augmented)

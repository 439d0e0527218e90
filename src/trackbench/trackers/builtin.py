"""Built-in filters as trackers, made from the options of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from pydantic import create_model

from trackbench.filters import (
    CUBATURE,
    ExtendedKalmanFilter,
    Filter,
    InteractingMultipleModel,
    IteratedExtendedKalmanFilter,
    KalmanFilter,
    MotionWithErrors,
    SigmaPointFilter,
    SingleModelFilter,
    SymmetricSet,
)
from trackbench.models.motion import MotionModel
from trackbench.trackers.assume import error_states
from trackbench.trackers.config import FilterConfig, FilterName, ImmConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.late import LateScans

#: Description of each filter, shown by ``trackbench list filters``.
FILTERS = {
    "kf": "Kalman filter on positions (a radar measurement is converted, its range rate left out); motion cv or ca",
    "ekf": "extended Kalman filter of first order",
    "iekf": "iterated extended Kalman filter, five times linearised",
    "ukf": "unscented Kalman filter, scaled or classic sigma points, augmented or not",
    "ckf": "cubature Kalman filter of third degree",
}


def build(config: FilterConfig) -> LateScans:
    """Return the built-in tracker that a scenario's settings under ``filter:`` describe."""
    tracker = FilterTracker(filter_of(config), config.initial, **config.scan_options)
    return LateScans(tracker, config.late, config.lag_s)


def _factory(name: FilterName) -> Callable[..., LateScans]:
    def factory(**options: Any) -> LateScans:
        return build(FilterConfig(filter=name, **options))

    factory.__name__ = factory.__qualname__ = name
    factory.__doc__ = f"{FILTERS[name][0].upper()}{FILTERS[name][1:]}."
    fields: dict[str, Any] = {"filter": (Literal[name], name), "smoother": (None, None)}
    factory.Options = create_model(name, __base__=FilterConfig, **fields)  # type: ignore[attr-defined]
    return factory


kf = _factory("kf")
ekf = _factory("ekf")
iekf = _factory("iekf")
ukf = _factory("ukf")
ckf = _factory("ckf")


def filter_of(config: FilterConfig) -> Filter[Any]:
    """Return the filter, with its motion models, that a scenario's settings under ``filter:`` describe."""
    errors = error_states(config.assume)
    models = [MotionWithErrors(motion=motion, errors=errors) if errors else motion for motion in config.models]
    filters = tuple(single_model_filter(config, motion) for motion in models)
    if not isinstance(config.motion, ImmConfig):
        return filters[0]
    return InteractingMultipleModel(filters, tuple(config.motion.stay_s), config.motion.first_probabilities)


def single_model_filter(config: FilterConfig, motion: MotionModel) -> SingleModelFilter:
    match config.filter:
        case "kf":
            return KalmanFilter(motion)
        case "ekf":
            return ExtendedKalmanFilter(motion)
        case "iekf":
            return IteratedExtendedKalmanFilter(motion)
        case "ckf":
            return SigmaPointFilter(motion, CUBATURE, augmented=False)
        case "ukf":
            is_scaled = config.sigma_points == "scaled"
            rule = SymmetricSet(1.0, 2.0, config.kappa or 0.0) if is_scaled else SymmetricSet(1.0, 0.0, config.kappa)
            return SigmaPointFilter(motion, rule, config.augmented)

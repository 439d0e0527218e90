"""Faults in trackbench's own trackers: options, wrong models in their filters, and wrong sensor models beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

from trackbench.base.types import Scan
from trackbench.models.motion import MotionModel
from trackbench.models.sensors import SENSOR_MODELS, Lidar, Sensor
from trackbench.trackers import builtin
from trackbench.trackers.filtered import FilterTracker

from . import builtin_models as wrong
from .jacobian_faults import RadarRow
from .method_faults import JACOBIANS
from .mutant import ExaminedTracker, Mutant


def _initial(start: str, velocity_sigma: float) -> dict[str, Any]:
    wide = {"velocity": "zero", "velocity_sigma_mps": velocity_sigma}
    known = wide if start == "first_measurement" else {"least_time_s": 0}
    return {"from": start, **known}


def ekf_cv(
    start: str = "first_measurement", velocity_sigma: float = 20.0, acceleration_sigma: float = 3.0
) -> FilterTracker:
    initial = _initial(start, velocity_sigma)
    return builtin.ekf(motion="cv", acceleration_sigma_mps2=acceleration_sigma, initial=initial).tracker


def kf_cv(
    start: str = "first_measurement", velocity_sigma: float = 20.0, acceleration_sigma: float = 3.0
) -> FilterTracker:
    initial = _initial(start, velocity_sigma)
    return builtin.kf(motion="cv", acceleration_sigma_mps2=acceleration_sigma, initial=initial).tracker


def ukf_ctrv(
    start: str = "two_measurements",
    velocity_sigma: float = 20.0,
    acceleration_sigma: float = 3.0,
    yaw_acceleration_sigma: float = 0.5,
    augmented: bool = True,
) -> FilterTracker:
    tracker = builtin.ukf(
        motion="ctrv",
        acceleration_sigma_mps2=acceleration_sigma,
        yaw_acceleration_sigma_radps2=yaw_acceleration_sigma,
        initial=_initial(start, velocity_sigma),
        augmented=augmented,
    )
    # As the filters of a page of NumPy, it has no other state than its own.
    return replace(tracker.tracker, cartesian_fallback="never")


EKF = ExaminedTracker("builtin_ekf", ekf_cv)
UKF = ExaminedTracker("builtin_ukf", ukf_ctrv, turning=True)
KF = ExaminedTracker("builtin_kf", kf_cv, uses_rate=False)


class SeenBy:
    """A tracker with a wrong model for one kind of sensor, at every step or at the first."""

    def __init__(self, tracker: FilterTracker, model: type[Sensor], first_only: bool = False) -> None:
        self.tracker, self.first_only = tracker, first_only
        self.models = {"lidar" if issubclass(model, Lidar) else "radar": model}
        self.batched = tracker.batched

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        if self.first_only and state is not None:
            return self.tracker.step(state, scan)
        with patch.dict(SENSOR_MODELS.found, self.models):
            return self.tracker.step(state, scan)


def _with_motion(tracker: FilterTracker, motion: Callable[..., MotionModel]) -> FilterTracker:
    right = tracker.filter.motion
    return replace(tracker, filter=replace(tracker.filter, motion=motion(**dict(right))))


def _with_correction(tracker: FilterTracker, change: Callable[..., Any]) -> FilterTracker:
    return replace(tracker, filter=wrong.Corrected(tracker.filter.motion, tracker.filter, change))


def _certain(tracker: FilterTracker) -> FilterTracker:
    """A first covariance that is tiny in every component."""
    variances = [1e-4] * len(tracker.filter.motion.components)
    return replace(tracker, initial=tracker.initial.model_copy(update={"covariance_diag": variances}))


def any_filter(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.behind("overconfident_start", "all", _certain)
    start = {"start": "first_measurement"}
    polar = wrong.RadarPolarStart
    yield subject.behind("polar_start", "position", SeenBy, polar, True, sensor="radar", options=start)
    corrections = [
        ("covariance_asymmetric", "update", wrong.upper_triangle_off, None),
        ("measurement_ignored", "radar_mean_kept", wrong.mean_kept("radar"), "radar"),
        ("measurement_ignored", "lidar_mean_kept", wrong.mean_kept("lidar"), "lidar"),
        ("covariance_not_reduced", "update", wrong.covariance_kept, None),
        ("velocity_not_kept", "update", wrong.velocity_shrunk, None),
    ]
    for fault, variant, change, kind in corrections:
        yield subject.behind(fault, variant, _with_correction, change, sensor=kind)
    noise = wrong.TurningNoiseOfFixedStep if subject.turning else wrong.VelocityNoiseOfFixedStep
    yield subject.behind("q_constant_per_step", "0.1", _with_motion, noise)
    noise = wrong.TurningNoisePerSecond if subject.turning else wrong.VelocityNoisePerSecond
    yield subject.behind("nonfinite", "dt_in_noise", _with_motion, noise)


def predictions(subject: ExaminedTracker) -> Iterator[Mutant]:
    models = [
        ("azimuth_not_wrapped", "residual", wrong.RadarNotWrapped),
        ("arctan_quadrant", "prediction", wrong.RadarByArctan),
        ("degrees_for_radians", "prediction", wrong.RadarInDegrees),
        ("speed_for_range_rate", "over_ground", wrong.RadarOfSpeed),
    ]
    for fault, variant, model in models:
        yield subject.behind(fault, variant, SeenBy, model, sensor="radar")


def linearised(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.behind("doppler_sign", "prediction", SeenBy, wrong.RadarRateNegated, sensor="radar")
    for variant, fault, kind in JACOBIANS:
        model = wrong.radar_with_jacobian(fault) if issubclass(fault, RadarRow) else wrong.LidarNotTurned
        yield subject.behind("jacobian_wrong", variant, SeenBy, model, sensor=kind)
    yield subject.behind("jacobian_wrong", "dt_missing", _with_motion, wrong.TimeStepMissing)
    yield subject.behind("nonfinite", "range", SeenBy, wrong.RadarWithoutGuard)


def turning(subject: ExaminedTracker) -> Iterator[Mutant]:
    start = {"start": "two_measurements"}
    yield subject.behind("arctan_quadrant", "first_course", _with_motion, wrong.CourseByArctan, options=start)
    subtracting = wrong.subtracts_too_much
    yield subject.behind("covariance_update_wrong", "subtracts_too_much", _with_correction, subtracting)
    yield subject.behind("nonfinite", "yaw_rate", _with_motion, wrong.TurnNotGuarded)
    yield subject.behind("course_not_wrapped", "spread", _with_motion, wrong.CourseNotWrapped)

"""The mutants of the plain trackers in which a method is wrong."""

from __future__ import annotations

from collections.abc import Iterator

from . import filter_faults as filtering
from . import jacobian_faults as jacobian
from . import sensor_faults as sensing
from . import sigma_point_faults as points
from .mutant import ExaminedTracker, Mutant

PREDICTIONS = [
    ("azimuth_not_wrapped", "residual", sensing.BareResidual),
    ("arctan_quadrant", "prediction", sensing.Arctan),
    ("degrees_for_radians", "prediction", sensing.AzimuthInDegrees),
    ("speed_for_range_rate", "over_ground", sensing.SpeedOverGround),
    ("speed_for_range_rate", "relative", sensing.RelativeSpeed),
]
JACOBIANS = [
    ("azimuth_sign", jacobian.AzimuthSign, "radar"),
    ("azimuth_over_range", jacobian.AzimuthOverRange, "radar"),
    ("azimuth_in_degrees", jacobian.AzimuthRowInDegrees, "radar"),
    ("azimuth_swapped", jacobian.AzimuthSwapped, "radar"),
    ("rate_without_position", jacobian.RateWithoutPosition, "radar"),
    ("rate_term_missing", jacobian.RateTermMissing, "radar"),
    ("rate_velocity_swapped", jacobian.RateVelocitySwapped, "radar"),
    ("lidar_not_turned", jacobian.LidarNotTurned, "lidar"),
]
MOTION_JACOBIANS = [("dt_missing", jacobian.TimeStepMissing), ("dt_misplaced", jacobian.TimeStepMisplaced)]
SIGMA_POINTS = [
    ("sigma_weights_wrong", "equal", points.EqualWeights, None),
    ("sigma_weights_wrong", "centre_left_out", points.CentreLeftOut, None),
    ("sigma_weights_wrong", "covariance_weights_for_mean", points.CovarianceWeightsForMean, None),
    ("sigma_spread_wrong", "other_kappa", points.OtherKappa, None),
    ("sigma_spread_wrong", "root_forgotten", points.RootForgotten, None),
    ("sigma_spread_wrong", "spread_forgotten", points.SpreadForgotten, None),
    ("sigma_points_misdrawn", "rows_for_columns", points.RowsForColumns, None),
    ("gain_inconsistent", "other_kappa_in_update", points.OtherKappaInUpdate, None),
    ("measurement_noise_omitted", "update", points.NoiseOmitted, None),
    ("measurement_noise_twice", "update", points.NoiseTwice, "radar"),
    ("process_noise_omitted", "prediction", points.ProcessNoiseOmitted, None),
]
CORRECTIONS = [
    ("covariance_asymmetric", "update", filtering.UnsymmetricUpdate, None),
    ("predicted_covariance_asymmetric", "one_sided_noise", filtering.OneSidedNoise, None),
    ("predicted_covariance_asymmetric", "one_entry", filtering.EntryAdded, None),
    ("covariance_update_wrong", "subtracts_too_much", filtering.SubtractsTooMuch, None),
    ("predicted_covariance_not_psd", "correlation_beyond_one", filtering.NoiseTooCorrelated, None),
    ("covariance_update_wrong", "twice", filtering.CovarianceUpdatedTwice, None),
    ("covariance_update_wrong", "other_gain", filtering.OtherGainInCovariance, None),
    ("gain_inconsistent", "mean_moved_farther", filtering.MeanMovedFarther, None),
    ("exception_raised", "missed_measurement", filtering.MissedRaises, None),
    ("measurement_ignored", "radar_mean_kept", filtering.RadarNotMoved, "radar"),
    ("measurement_ignored", "lidar_mean_kept", filtering.LidarNotMoved, "lidar"),
]


def predictions(subject: ExaminedTracker) -> Iterator[Mutant]:
    for fault, variant, mixin in PREDICTIONS:
        yield subject.mixed(fault, variant, mixin, "radar")


def linearised(subject: ExaminedTracker) -> Iterator[Mutant]:
    # Without a Jacobian this is the same as a negated measurement.
    yield subject.mixed("doppler_sign", "prediction", sensing.RateNegated, "radar")
    for variant, mixin, kind in JACOBIANS:
        yield subject.mixed("jacobian_wrong", variant, mixin, kind)


def motion_jacobians(subject: ExaminedTracker) -> Iterator[Mutant]:
    for variant, mixin in MOTION_JACOBIANS:
        yield subject.mixed("jacobian_wrong", variant, mixin)


def starts(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.mixed("overconfident_start", "all", filtering.CertainStart)
    for variant, mixin in (("position", filtering.PolarStart), ("with_rate", filtering.PolarStartWithRate)):
        yield subject.mixed("polar_start", variant, mixin, "radar", start="first_measurement")
    yield subject.mixed("nonfinite", "dt_in_start", filtering.StartAtOneInstant, start="two_measurements")


def corrections(subject: ExaminedTracker) -> Iterator[Mutant]:
    for fault, variant, mixin, kind in CORRECTIONS:
        yield subject.mixed(fault, variant, mixin, kind)
    yield Mutant(
        "not_deterministic", subject.name, "class_attribute", filtering.surviving(subject.tracker), subject.tracker
    )


def divisions(subject: ExaminedTracker) -> Iterator[Mutant]:
    """Divisions by values that can be zero."""
    fault = "nonfinite"
    yield subject.mixed(fault, "dt_in_noise", filtering.NoisePerSecond)
    if subject.turning:
        yield subject.mixed(fault, "yaw_rate", filtering.UnguardedTurn)
        yield subject.mixed(fault, "speed", filtering.UnguardedSpeed, start="first_measurement")
    else:
        yield subject.mixed(fault, "speed", filtering.NoiseAlongCourse)
    if subject.uses_rate:
        yield subject.mixed(fault, "range", filtering.UnguardedRange)


def unscented(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.mixed("angle_mean_not_circular", "spread", sensing.BareSpread, "radar")
    yield subject.mixed("angle_mean_not_circular", "mean", sensing.BareMean, "radar")
    yield subject.mixed("arctan_quadrant", "first_course", filtering.ArctanCourse, start="two_measurements")


def innovation(subject: ExaminedTracker) -> Iterator[Mutant]:
    yield subject.mixed("azimuth_not_wrapped", "innovation", sensing.BareInnovation, "radar")


def raising(subject: ExaminedTracker) -> Mutant:
    """Its Cholesky factor fails after an update at the azimuth pi."""
    return subject.mixed("angle_mean_not_circular", "cross_covariance", sensing.BareCross, "radar")


def sigma_points(subject: ExaminedTracker) -> Iterator[Mutant]:
    for fault, variant, mixin, kind in SIGMA_POINTS:
        yield subject.mixed(fault, variant, mixin, kind)
    yield subject.mixed("sigma_points_not_redrawn", "update", points.NotRedrawn)

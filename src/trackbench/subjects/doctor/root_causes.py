"""Which findings are root causes, and which are their consequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

from trackbench.subjects.doctor.findings import Finding, faults_of
from trackbench.subjects.doctor.output_checks import SINGULAR

#: A covariance or an estimate that is none. What is sure of them has begun at a good estimate, and has no other cause.
NUMERICAL = ("covariance_not_psd", "predicted_covariance_not_psd", "nonfinite", "invalid_estimate")
#: Found without a model of the tracker, or by one that fits it exactly, so that no other fault looks like them.
EXACT = (
    "azimuth_not_wrapped",
    "angle_mean_not_circular",
    "course_not_wrapped",
    "arctan_quadrant",
    "axis_swapped",
    "axis_mirrored",
    "degrees_for_radians",
    "doppler_sign",
    "speed_for_range_rate",
    "ego_motion_ignored",
    "sensor_pose_ignored",
    "measurement_ignored",
    "second_measurement_dropped",
    "missed_scan_not_predicted",
    "integer_state_matrix",
    "sigma_weights_wrong",
    "exception_raised",
    "process_ended",
    *NUMERICAL,
)
#: Found without a measurement: the use of one sensor's measurements does not change them.
MOTION = (
    *("wrong_dt", "velocity_unit", "process_noise_omitted"),
    *("q_too_small", "q_too_large", "q_constant_per_step", "q_wrong_power_of_dt"),
)
#: What a prediction over no time shows of the sums over sigma points. Wide points have other courses and azimuths.
_SUMS = ("sigma_weights_wrong", "sigma_points_misdrawn", "sigma_spread_wrong")
#: Of a covariance that is returned and is not the tracker's own.
OWN = ("covariance_constant", "covariance_diagonal", "covariance_order")
#: Of the sensor's own pose and velocity.
_EGO = ("ego_motion_ignored", "sensor_pose_ignored")
#: What the estimates of drives show of any fault.
DRIVEN = ("too_far_off", "covariance_unbelievable")

#: Consequences whatever their sensor, and although they are exact otherwise: y / x is not a number at the sensor, an
#: indefinite covariance has no square root, points on either side of pi and points far from their mean have sums that
#: are no covariance, what a prediction does to the covariance is there after the update, measurements do not move whole
#: numbers, a position or velocity with a factor has other angles and range rates, and the covariance of one sensor's
#: updates is that of the predictions after them.
DIRECT = (
    ("arctan_quadrant", "nonfinite"),
    ("covariance_not_psd", "nonfinite"),
    ("predicted_covariance_not_psd", "nonfinite"),
    *product(("course_not_wrapped", "q_too_large"), ("predicted_covariance_not_psd", "covariance_not_psd")),
    ("predicted_covariance_not_psd", "covariance_not_psd"),
    ("angle_mean_not_circular", "azimuth_not_wrapped"),
    ("integer_state_matrix", "measurement_ignored"),
    ("second_measurement_dropped", "measurement_ignored"),
    ("sigma_weights_wrong", "arctan_quadrant"),
    *product(_SUMS, ("course_not_wrapped", "angle_mean_not_circular", *NUMERICAL)),
    *(("velocity_unit", fault) for fault in (*_EGO, "doppler_sign", "speed_for_range_rate")),
    ("process_noise_twice", "q_too_large"),
    *product(("q_wrong_power_of_dt",), NUMERICAL),
    *(("covariance_not_reduced", fault) for fault in MOTION),
)

#: Confidence from which on a finding can be the cause of others.
SURE = 0.8
#: Confidence from which on an exact finding is the consequence of no other.
CERTAIN = 0.9

#: What a wrong gain is called, with a Jacobian, with sigma points, and by what its update adds.
_GAIN = ("jacobian_wrong", "gain_inconsistent", "sigma_points_not_redrawn", "process_noise_twice")
_NOISE = ("r_too_small", "r_too_large", "measurement_noise_omitted", "measurement_noise_twice")
_GROWTH = (
    *("q_too_small", "q_too_large", "q_constant_per_step", "q_wrong_power_of_dt"),
    *("process_noise_omitted", "process_noise_twice"),
)
_OFFSET = ("sensor_bias", "scale_error", "time_offset")
#: What a wrong mean or covariance can look like after a step, or after many.
_STEP = ("velocity_not_kept", "gate_never_reopens", "covariance_not_reduced", "covariance_update_wrong", *OWN)
_POINTS = ("sigma_spread_wrong", "sigma_points_misdrawn")
_ANGLE = ("azimuth_not_wrapped", "angle_mean_not_circular", "course_not_wrapped")
#: Of measurements that are predicted or read wrongly.
_MEASURED = (*_GAIN, "course_not_wrapped", "overconfident_start", *_STEP, *_POINTS, *NUMERICAL)
#: Of a wrong step of the state, after which the innovations of all measurements are wrong too.
_STEPPED = (*_GAIN, *_NOISE, *_GROWTH, *_OFFSET, *_STEP, *_POINTS, *_ANGLE, "overconfident_start", *NUMERICAL)
_COVARIANCE = (*_GAIN, "azimuth_not_wrapped", *_NOISE, *_GROWTH, *_STEP, "overconfident_start")
_AXES = ("arctan_quadrant", *_ANGLE, *_EGO, *_MEASURED, *_NOISE, *_GROWTH, "wrong_dt", "velocity_unit")

#: The consequences that each fault can have; causes are tried in this order.
CONSEQUENCES: dict[str, tuple[str, ...]] = {
    "not_deterministic": tuple(
        fault for fault in faults_of("trackbench.subjects.doctor") if fault != "exception_raised"
    ),
    "integer_state_matrix": ("wrong_dt", "measurement_ignored", *_STEPPED),
    "sigma_weights_wrong": ("wrong_dt", "velocity_unit", "arctan_quadrant", *_STEPPED),
    "sigma_points_misdrawn": ("sigma_spread_wrong", "wrong_dt", *_STEPPED),
    "sigma_spread_wrong": ("wrong_dt", *_STEPPED),
    "velocity_unit": ("wrong_dt", *_EGO, "doppler_sign", "speed_for_range_rate", *_STEPPED),
    "axis_swapped": _AXES,
    "axis_mirrored": _AXES,
    "degrees_for_radians": ("arctan_quadrant", *_ANGLE, *_NOISE, *_MEASURED),
    "ego_motion_ignored": ("arctan_quadrant", *_NOISE, *_MEASURED),
    "sensor_pose_ignored": ("polar_start", "arctan_quadrant", *_ANGLE, *_NOISE, *_MEASURED),
    "arctan_quadrant": (*_ANGLE, *_MEASURED),
    # Their third row of the Jacobian is wrong too, unless it is left right.
    "doppler_sign": _MEASURED,
    "speed_for_range_rate": _MEASURED,
    "measurement_noise_omitted": ("polar_start", "wrong_dt", *_STEPPED),
    "covariance_not_reduced": ("wrong_dt", *_STEPPED),
    "missed_scan_not_predicted": _STEPPED,
    "angle_mean_not_circular": (*_ANGLE, *_MEASURED, *_NOISE),
    "course_not_wrapped": (*_ANGLE, *_MEASURED, *_NOISE, *_GROWTH, *_OFFSET),
    "wrong_dt": (*_MEASURED, *_GROWTH, "time_offset"),
    "q_wrong_power_of_dt": (*_GAIN, *_GROWTH, *_NOISE, "overconfident_start", *NUMERICAL),
    "q_too_large": NUMERICAL,
    "predicted_covariance_not_psd": (*_COVARIANCE, *_POINTS, "covariance_not_psd", "nonfinite"),
    "predicted_covariance_asymmetric": (*_GAIN, "azimuth_not_wrapped", "covariance_asymmetric", *NUMERICAL),
    "q_constant_per_step": (*_GAIN, *_POINTS, *_GROWTH, "overconfident_start"),
    "velocity_not_kept": ("wrong_dt", *_STEPPED),
    "time_offset": (*_ANGLE, *_MEASURED, *_GROWTH, "sensor_bias", "scale_error"),
    "second_measurement_dropped": ("measurement_ignored",),
    "covariance_asymmetric": (*_GAIN, "azimuth_not_wrapped", *NUMERICAL),
    "covariance_not_psd": (*_COVARIANCE, "nonfinite"),
    "sensor_bias": (*_GAIN, "overconfident_start", *NUMERICAL),
    "scale_error": (*_GAIN, "overconfident_start", *NUMERICAL),
    "process_noise_omitted": ("q_too_small", "overconfident_start", *NUMERICAL),
    **dict.fromkeys(OWN, (*_STEPPED, "jacobian_wrong", "covariance_update_wrong")),
    "sigma_points_not_redrawn": ("gain_inconsistent", "jacobian_wrong", *_NOISE, *_GROWTH, *NUMERICAL),
    "process_noise_twice": ("gain_inconsistent", "covariance_update_wrong", "q_too_large"),
    "covariance_update_wrong": (*_NOISE, *_GROWTH, *_ANGLE, "overconfident_start", *NUMERICAL),
    "gain_inconsistent": (*_ANGLE, *_NOISE, *_GROWTH, "overconfident_start", *NUMERICAL),
    "jacobian_wrong": (*_ANGLE, *_NOISE, *_GROWTH, *NUMERICAL),
    "azimuth_not_wrapped": NUMERICAL,
    "measurement_noise_twice": NUMERICAL,
    "measurement_ignored": ("nonfinite",),
    "polar_start": ("overconfident_start", "sensor_bias"),
    "r_too_small": ("overconfident_start", *NUMERICAL),
    "r_too_large": NUMERICAL,
    "q_too_small": NUMERICAL,
    "too_far_off": ("covariance_unbelievable",),
}


def rank(findings: Iterable[Finding]) -> list[Finding]:
    """One finding for each fault and sensor: root causes first, then consequences, each by falling confidence."""
    unique: dict[tuple[str, str | None], Finding] = {}
    for finding in findings:
        key = (finding.fault, finding.sensor)
        if key not in unique or finding.confidence > unique[key].confidence:
            unique[key] = finding
    order = list(CONSEQUENCES)
    ordered = sorted(
        unique.values(),
        key=lambda one: (
            one.confidence < SURE,
            one.fault in DRIVEN,
            order.index(one.fault) if one.fault in order else len(order),
        ),
    )
    ranked: list[Finding] = []
    for finding in ordered:
        roots = (root for root in ranked if root.consequence_of is None)
        cause = next((root.fault for root in roots if _causes(root, finding)), None)
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda one: (one.consequence_of is not None, _at_sensor(one), -one.confidence))


def _at_sensor(finding: Finding) -> bool:
    """Whether it arises only where the range is 0, as in no drive that is judged."""
    return finding.shown_by in SINGULAR


def _causes(root: Finding, finding: Finding) -> bool:
    """Whether a finding can be the consequence of a root cause, in its sensor and place."""
    if root.confidence < SURE or root.fault == finding.fault:
        return False
    if finding.fault in DRIVEN and root.fault not in DRIVEN:
        return not _at_sensor(root)
    if finding.fault not in CONSEQUENCES.get(root.fault, ()):
        return False
    if (root.fault, finding.fault) in DIRECT or root.fault == "not_deterministic":
        return True
    if finding.fault in EXACT and finding.confidence >= CERTAIN:
        return False
    if finding.fault in MOTION or (finding.fault == "jacobian_wrong" and finding.sensor is None):
        return root.sensor is None
    return root.sensor is None or finding.sensor is None or root.sensor == finding.sensor

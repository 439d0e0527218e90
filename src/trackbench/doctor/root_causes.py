"""Which findings are root causes, and which are their consequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackbench.doctor.findings import Finding, faults_of

#: Wrong sizes. Wrong models of other kinds look like these too.
SIZES = (
    *("r_too_small", "r_too_large", "q_too_small", "q_too_large", "overconfident_start", "sensor_bias"),
    *("scale_error", "time_offset", "q_constant_per_step", "process_noise_twice"),
)
#: Consequences of a covariance that is not positive definite.
NUMERICAL = ("covariance_not_psd", "nonfinite")
#: What the estimates of drives show of any fault.
DRIVEN = ("too_far_off", "covariance_unbelievable")
#: What a wrong prediction of the mean or of the covariance can look like.
STEPPED = ("velocity_not_kept", "gate_never_reopens", "covariance_not_reduced", "course_not_wrapped")
_MODEL = ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, *STEPPED, *NUMERICAL)

#: Confidence from which on a finding can be the cause of others.
SURE = 0.8

#: The consequences that each fault can have; causes are tried in this order.
CONSEQUENCES: dict[str, tuple[str, ...]] = {
    "not_deterministic": tuple(faults_of("trackbench.doctor")),
    "axis_swapped": ("arctan_quadrant", "wrong_dt", "ego_motion_ignored", *_MODEL),
    "axis_mirrored": ("arctan_quadrant", "wrong_dt", "ego_motion_ignored", *_MODEL),
    "degrees_for_radians": ("arctan_quadrant", *_MODEL),
    "ego_motion_ignored": ("arctan_quadrant", *_MODEL),
    "arctan_quadrant": _MODEL,
    "doppler_sign": _MODEL,
    "speed_for_range_rate": _MODEL,
    "integer_state_matrix": ("wrong_dt", "measurement_ignored", "azimuth_not_wrapped", *_MODEL),
    "covariance_not_reduced": ("wrong_dt", "jacobian_wrong", "azimuth_not_wrapped", "velocity_not_kept", *SIZES),
    "missed_scan_not_predicted": ("azimuth_not_wrapped", *_MODEL),
    "wrong_dt": ("jacobian_wrong", *SIZES, *STEPPED, *NUMERICAL),
    "q_constant_per_step": ("jacobian_wrong", "process_noise_twice", *SIZES),
    "velocity_not_kept": ("wrong_dt", *_MODEL),
    "course_not_wrapped": ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, *STEPPED, *NUMERICAL),
    "time_offset": ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, *STEPPED, *NUMERICAL),
    "second_measurement_dropped": ("measurement_ignored",),
    "scale_error": ("jacobian_wrong", "overconfident_start", "covariance_not_psd"),
    "process_noise_twice": ("q_too_large",),
    "covariance_asymmetric": ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, *NUMERICAL),
    "covariance_not_psd": ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, "nonfinite"),
    "azimuth_not_wrapped": NUMERICAL,
    "sensor_bias": ("jacobian_wrong", "overconfident_start", "covariance_not_psd"),
    "jacobian_wrong": ("azimuth_not_wrapped", *SIZES, *NUMERICAL),
    "measurement_ignored": ("nonfinite",),
    "polar_start": ("overconfident_start", "sensor_bias"),
    "r_too_small": ("overconfident_start", *NUMERICAL),
    "r_too_large": NUMERICAL,
    "q_too_large": NUMERICAL,
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
        cause = next(
            (
                root.fault
                for root in ranked
                if root.consequence_of is None
                and root.confidence >= SURE
                and root.fault != finding.fault
                and finding.fault in (*CONSEQUENCES.get(root.fault, ()), *(DRIVEN if root.fault not in DRIVEN else ()))
            ),
            None,
        )
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda one: (one.consequence_of is not None, -one.confidence))

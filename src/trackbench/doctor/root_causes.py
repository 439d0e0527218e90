"""Which findings are root causes, and which are their consequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackbench.doctor.findings import Finding, faults_of

#: Wrong sizes. Wrong models of other kinds look like these too.
SIZES = ("r_too_small", "r_too_large", "q_too_small", "q_too_large", "overconfident_start", "sensor_bias")
#: Consequences of a covariance that is not positive definite.
NUMERICAL = ("covariance_not_psd", "nonfinite")
#: What a wrong gain is called, with a Jacobian or with sigma points.
_GAIN = ("jacobian_wrong", "gain_inconsistent", "sigma_points_not_redrawn")
#: What wrong sums over sigma points look like besides.
_SUMS = (
    *(*_GAIN, "measurement_noise_twice", "measurement_noise_omitted"),
    *("azimuth_not_wrapped", "angle_mean_not_circular", *SIZES, *NUMERICAL),
)
_MODEL = (*_SUMS, "sigma_spread_wrong", "sigma_points_misdrawn")

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
    "sigma_weights_wrong": (*_MODEL, "wrong_dt", "velocity_unit", "arctan_quadrant", "process_noise_omitted"),
    "measurement_noise_omitted": (*_MODEL, "polar_start", "process_noise_omitted", "wrong_dt"),
    "wrong_dt": (*_MODEL, "process_noise_omitted"),
    "velocity_unit": (*_MODEL, "ego_motion_ignored", "doppler_sign", "speed_for_range_rate", "wrong_dt"),
    "sigma_points_misdrawn": (*_SUMS, "sigma_spread_wrong", "process_noise_omitted"),
    "sigma_spread_wrong": (*_SUMS, "process_noise_omitted"),
    "angle_mean_not_circular": _SUMS,
    "covariance_asymmetric": (*_GAIN, "azimuth_not_wrapped", *SIZES, *NUMERICAL),
    "covariance_not_psd": (*_GAIN, "azimuth_not_wrapped", *SIZES, "nonfinite"),
    "azimuth_not_wrapped": ("angle_mean_not_circular", *NUMERICAL),
    "sensor_bias": (*_GAIN, "overconfident_start", "covariance_not_psd"),
    "process_noise_omitted": ("q_too_small", *NUMERICAL, "overconfident_start"),
    "sigma_points_not_redrawn": ("gain_inconsistent", "jacobian_wrong", *SIZES, *NUMERICAL),
    "gain_inconsistent": ("azimuth_not_wrapped", *SIZES, *NUMERICAL),
    "measurement_noise_twice": NUMERICAL,
    "jacobian_wrong": ("azimuth_not_wrapped", *SIZES, *NUMERICAL),
    "measurement_ignored": ("nonfinite",),
    "polar_start": ("overconfident_start", "sensor_bias"),
    "r_too_small": ("overconfident_start", *NUMERICAL),
    "r_too_large": NUMERICAL,
    "q_too_large": NUMERICAL,
    "q_too_small": NUMERICAL,
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
        key=lambda one: (one.confidence < SURE, order.index(one.fault) if one.fault in order else len(order)),
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
                and finding.fault in CONSEQUENCES.get(root.fault, ())
            ),
            None,
        )
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda one: (one.consequence_of is not None, -one.confidence))

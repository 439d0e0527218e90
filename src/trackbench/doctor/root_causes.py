"""Which findings are root causes, and which are their consequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackbench.doctor.findings import Finding, faults_of

#: A covariance or an estimate that is none. What is sure of them has begun at a good estimate, and has no other cause.
NUMERICAL = ("covariance_not_psd", "predicted_covariance_not_psd", "nonfinite", "invalid_estimate")
#: Found without a model of the tracker, or by one that fits it exactly, so that no other fault looks like them.
EXACT = (
    "azimuth_not_wrapped",
    "azimuth_mean_not_circular",
    "arctan_quadrant",
    "axis_swapped",
    "axis_mirrored",
    "degrees_for_radians",
    "doppler_sign",
    "speed_for_range_rate",
    "ego_motion_ignored",
    "measurement_ignored",
    "exception_raised",
    "process_ended",
    *NUMERICAL,
)
#: Found without a measurement: the use of one sensor's measurements does not change them.
MOTION = ("wrong_dt", "q_too_small", "q_too_large")

#: What is not exact after all beside such a cause: y / x is not a number at the sensor, an indefinite covariance has
#: no square root, and what a prediction does to the covariance is there after the update.
DIRECT = (
    ("arctan_quadrant", "nonfinite"),
    ("covariance_not_psd", "nonfinite"),
    ("predicted_covariance_not_psd", "nonfinite"),
    ("predicted_covariance_not_psd", "covariance_not_psd"),
    ("azimuth_mean_not_circular", "azimuth_not_wrapped"),
)

#: Confidence from which on a finding can be the cause of others.
SURE = 0.8
#: Confidence from which on an exact finding is the consequence of no other.
CERTAIN = 0.9

_NOISE = ("r_too_small", "r_too_large")
_COVARIANCE = ("jacobian_wrong", "azimuth_not_wrapped", *_NOISE, "q_too_small", "q_too_large", "overconfident_start")
_AXES = ("arctan_quadrant", "azimuth_not_wrapped", "ego_motion_ignored", "jacobian_wrong", *_NOISE, *MOTION)

#: The consequences that each fault can have; causes are tried in this order.
CONSEQUENCES: dict[str, tuple[str, ...]] = {
    "not_deterministic": tuple(fault for fault in faults_of("trackbench.doctor") if fault != "exception_raised"),
    "axis_swapped": (*_AXES, "overconfident_start", *NUMERICAL),
    "axis_mirrored": (*_AXES, "overconfident_start", *NUMERICAL),
    "degrees_for_radians": (
        *("arctan_quadrant", "azimuth_not_wrapped", "jacobian_wrong", *_NOISE, "overconfident_start"),
        *NUMERICAL,
    ),
    "ego_motion_ignored": ("arctan_quadrant", "jacobian_wrong", *_NOISE, "overconfident_start", *NUMERICAL),
    "arctan_quadrant": ("azimuth_not_wrapped", "jacobian_wrong", "overconfident_start", *NUMERICAL),
    # Their third row of the Jacobian is wrong too, unless it is left right.
    "doppler_sign": ("jacobian_wrong", "overconfident_start", *NUMERICAL),
    "speed_for_range_rate": ("jacobian_wrong", "overconfident_start", *NUMERICAL),
    "azimuth_mean_not_circular": ("azimuth_not_wrapped", "jacobian_wrong", *NUMERICAL),
    "wrong_dt": ("jacobian_wrong", "q_too_small", "q_too_large", "overconfident_start", *NUMERICAL),
    "predicted_covariance_not_psd": (*_COVARIANCE, "covariance_not_psd", "nonfinite"),
    "predicted_covariance_asymmetric": ("jacobian_wrong", "azimuth_not_wrapped", "covariance_asymmetric", *NUMERICAL),
    "covariance_asymmetric": ("jacobian_wrong", "azimuth_not_wrapped", *NUMERICAL),
    "covariance_not_psd": (*_COVARIANCE, "nonfinite"),
    "azimuth_not_wrapped": NUMERICAL,
    "sensor_bias": ("jacobian_wrong", "overconfident_start", *NUMERICAL),
    "jacobian_wrong": ("azimuth_not_wrapped", *_NOISE, "q_too_small", "q_too_large", *NUMERICAL),
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
        roots = (root for root in ranked if root.consequence_of is None)
        cause = next((root.fault for root in roots if _causes(root, finding)), None)
        ranked.append(replace(finding, consequence_of=cause))
    return sorted(ranked, key=lambda one: (one.consequence_of is not None, -one.confidence))


def _causes(root: Finding, finding: Finding) -> bool:
    """Whether a finding can be the consequence of a root cause, in its sensor and place."""
    if root.confidence < SURE or root.fault == finding.fault or finding.fault not in CONSEQUENCES.get(root.fault, ()):
        return False
    if (root.fault, finding.fault) in DIRECT or root.fault == "not_deterministic":
        return True
    if finding.fault in EXACT and finding.confidence >= CERTAIN:
        return False
    if finding.fault in MOTION or (finding.fault == "jacobian_wrong" and finding.sensor is None):
        return root.sensor is None
    return root.sensor is None or finding.sensor is None or root.sensor == finding.sensor

"""Which of the findings is the root, and which follow from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from trackbench.doctor.findings import Finding, advice

#: Faults of size, which any fault of kind can make it seem that there are.
SIZES = ("r_too_small", "r_too_large", "q_too_small", "q_too_large", "overconfident_start", "sensor_bias")
#: What a covariance that is none leads to.
NUMERICAL = ("covariance_not_psd", "nonfinite")
_MODEL = ("jacobian_wrong", "azimuth_not_wrapped", *SIZES, *NUMERICAL)

#: Confidence below which a finding explains no other.
SURE = 0.8

#: What each fault can bring about.
EXPLAINS: dict[str, tuple[str, ...]] = {
    "not_deterministic": tuple(advice()),
    "axis_swapped": ("arctan_quadrant", "wrong_dt", "ego_motion_ignored", *_MODEL),
    "axis_mirrored": ("arctan_quadrant", "wrong_dt", "ego_motion_ignored", *_MODEL),
    "degrees_for_radians": ("arctan_quadrant", *_MODEL),
    "ego_motion_ignored": ("arctan_quadrant", *_MODEL),
    "arctan_quadrant": _MODEL,
    "doppler_sign": _MODEL,
    "speed_for_range_rate": _MODEL,
    "wrong_dt": ("jacobian_wrong", *SIZES, *NUMERICAL),
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
}


def weigh(findings: Iterable[Finding]) -> list[Finding]:
    """The findings, one of each fault and sensor, roots first and the surest of them at the top."""
    unique: dict[tuple[str, str | None], Finding] = {}
    for finding in findings:
        key = (finding.fault, finding.sensor)
        if key not in unique or finding.confidence > unique[key].confidence:
            unique[key] = finding
    order = list(EXPLAINS)
    ranked = sorted(
        unique.values(),
        key=lambda one: (one.confidence < SURE, order.index(one.fault) if one.fault in order else len(order)),
    )
    weighed: list[Finding] = []
    for finding in ranked:
        cause = next(
            (
                root.fault
                for root in weighed
                if root.consequence_of is None
                and root.confidence >= SURE
                and root.fault != finding.fault
                and finding.fault in EXPLAINS.get(root.fault, ())
            ),
            None,
        )
        weighed.append(replace(finding, consequence_of=cause))
    return sorted(weighed, key=lambda one: (one.consequence_of is not None, -one.confidence))

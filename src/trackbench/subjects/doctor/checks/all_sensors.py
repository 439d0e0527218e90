"""What the gains of all sensors have in common: one returned covariance that is too large, or one wrong gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackbench.subjects.doctor.checks.drives import harmless
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: Difference of the factors of sensors up to which they are one.
SAME_FACTOR = 0.1


def of_every_sensor(result: PartResult, tracker: TrackerUnderTest) -> PartResult:
    """With one finding for gains that are wrong in every sensor: their Jacobians have nothing in common."""
    wrong = [finding for finding in result.findings if finding.fault == "jacobian_wrong"]
    if len(wrong) < 2 or len(wrong) < len(tracker.sensors):
        return result
    text = f"the gains of all sensors are wrong; as if of a wrong Jacobian, {wrong[0].evidence}"
    of_all = replace(wrong[0], fault="gain_inconsistent", sensor=None, evidence=text)
    return PartResult(result.checks, [of_all, *(finding for finding in result.findings if finding not in wrong)])


def inflated(tracker: TrackerUnderTest, result: PartResult) -> PartResult:
    """Without the findings of one noise factor in all sensors, where it does no harm.

    The gains are then those of the stated noise, and the returned covariance is larger than that which they are of.
    """
    large = [finding for finding in result.findings if finding.fault in ("r_too_large", "measurement_noise_twice")]
    factors = [finding.factor for finding in large]
    sizes = np.array([factor for factor in factors if factor is not None])
    everywhere = len(sizes) == len(result.findings) == len(tracker.sensors) > 1
    if not everywhere or np.ptp(sizes) > SAME_FACTOR * sizes.min() or (harm := tracker.once(harmless)) is None:
        return result
    text = (
        f"the returned covariance is {np.median(sizes):.3g} times that of which the gains are made, and no harm: {harm}"
    )
    return PartResult([replace(check, passed=True, result=text) for check in result.checks])

"""Are the innovations right on a drive with noise?"""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.evidence import SensorInnovations, evidence_run
from trackbench.subjects.doctor.findings import CheckResult, DoctorCheck, PartResult, Question
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

#: The drive in which the azimuth passes pi.
DRIVE = "azimuth_crossing"
QUESTION = "Are all angles in the innovations wrapped where the azimuth passes pi?"


def innovations(tracker: TrackerUnderTest) -> PartResult:
    """Mean, NIS, autocorrelation and unwrapped angles of the innovations of each sensor."""
    found = next((pair for pair in tracker.drives if pair[0].name == DRIVE), None)
    if found is None:
        skipped = [f"innovations.{name}" for name in tracker.sensors]
        return PartResult([CheckResult(name, QUESTION, None, f"its drive {DRIVE} is skipped") for name in skipped])
    drive, reference = found
    return PartResult([_check(one) for one in evidence_run(tracker.make, drive, reference, []).innovations])


def _check(of: SensorInnovations) -> CheckResult:
    model = SENSOR_MODELS[of.kind]
    mean = np.nanmean(of.applied / of.sigma[:, None], axis=1)
    unwrapped = sum(int(np.sum(np.abs(of.applied[i]) > np.pi)) for i in model.angular)
    nis = float(np.nanmean(np.sum(of.whitened**2, axis=0)))
    parts = [
        "mean "
        + ", ".join(f"{name.replace('_', ' ')} {value:.2g}" for name, value in zip(of.components, mean, strict=True))
        + " sigma",
        f"NIS {nis:.3g} (expected: {len(of.sigma)})",
        f"lag-one autocorrelation {_autocorrelation(of.whitened):.2g}",
    ]
    if model.angular:
        parts.append(f"{unwrapped} of {of.applied.shape[1]} larger than pi")
    question = f"Are all angles in the innovations of {of.sensor} wrapped where the azimuth passes pi?"
    # The motion model alone can give the innovations a mean and a correlation in this drive; they are only reported.
    return CheckResult(f"innovations.{of.sensor}", question, unwrapped == 0, "; ".join(parts))


def _autocorrelation(whitened: Array) -> float:
    """Of successive innovations."""
    known: Mask = np.asarray(np.isfinite(whitened).all(axis=0))
    now, before = whitened[:, 1:], whitened[:, :-1]
    both: Mask = np.asarray(known[1:] & known[:-1])
    power = float(np.sum(now[:, both] ** 2))
    return float(np.sum(now[:, both] * before[:, both])) / power if power > 0.0 else 0.0


CHECKS = (
    DoctorCheck(
        innovations,
        place=210,
        questions=(Question("innovations", "Are all angles in the innovations wrapped?", each_sensor=True),),
        of_filters=True,
        asks_at_misses=True,
    ),
)

"""Does the tracker keep its target on drives with noise, and how does it compare with the reference?"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.drives import TestDrive
from trackbench.doctor.findings import CheckResult, PartResult
from trackbench.doctor.rollout import Rollout, rollout
from trackbench.doctor.session import StepFailed
from trackbench.doctor.tracker_under_test import TrackerUnderTest

#: Time at the start of a drive that is not scored, s.
SETTLE = 1.0
#: RMS position error from which on the target is lost, m.
LOST = 20.0


def drives(tracker: TrackerUnderTest) -> PartResult:
    """Run every test drive, with the measurements that the reference had."""
    result = PartResult()
    for drive, reference in tracker.drives:
        question = f"Does the tracker keep its target ({drive.config.description})?"
        try:
            estimates = rollout(tracker.make, drive.scans, tracker.output_checks, drive.name)
        except StepFailed as failure:
            tracker.failures.append((drive.name, failure))
            text = f"the tracker failed at {failure.scan.time:g} s: {failure}"
            result.checks.append(CheckResult(drive.name, question, False, text))
            continue
        (rmse, position, velocity), other = _scores(estimates, drive), _scores(reference, drive)
        text = (
            f"position RMSE {rmse:.3g} m, reference {other[0]:.3g} m; NEES of position {position:.3g} and of velocity "
            f"{velocity:.3g} (expected: 2), reference {other[1]:.3g} and {other[2]:.3g}"
        )
        result.checks.append(CheckResult(drive.name, question, rmse < LOST, text))
    return result


def _scores(estimates: Rollout, drive: TestDrive) -> tuple[float, float, float]:
    """RMS position error, and NEES of position and of velocity."""
    scored = drive.time > SETTLE
    error = (estimates.mean - drive.target)[:, scored]
    covariance = np.moveaxis(estimates.covariance[:, :, scored], (0, 1), (-2, -1))
    known = np.isfinite(error).all(axis=0) & np.isfinite(covariance).all(axis=(-2, -1))
    if not known.any():
        return np.inf, np.inf, np.inf
    e, p = error[:, known].T, covariance[known]
    squares = [
        np.einsum("ni,nij,nj->n", e[:, part], np.linalg.pinv(p[:, part, part]), e[:, part])
        for part in (slice(0, 2), slice(2, 4))
    ]
    return (
        float(np.sqrt(np.mean(np.sum(e[:, :2] ** 2, axis=1)))),
        float(np.mean(squares[0])),
        float(np.mean(squares[1])),
    )

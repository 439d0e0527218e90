"""What is said of the errors that a tracker raises."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trackbench.base.types import Scan
from trackbench.subjects.doctor.checks import drives
from trackbench.subjects.doctor.checks.steps import failure_findings
from trackbench.subjects.doctor.session import StepFailed
from trackbench.trackers.answers import TOO_LARGE, TrackerFault


def _under_test(cause: BaseException, where: str) -> Any:
    def scan(time: float) -> Scan:
        return Scan(
            time, "radar", "radar", np.ones(3), np.array(True), np.eye(3), np.zeros(3), np.zeros(2), time
        )  # fmt: skip

    class Failing:
        def step(self, state: Any, given: Scan) -> Any:
            if given.time > 1.0:
                raise cause
            return 1, (np.ones(4), np.eye(4))

    failure = StepFailed(cause, scan(1.5), [scan(1.0)])
    drives = [(SimpleNamespace(name="long_run"), None)]
    return SimpleNamespace(failures=[(where, failure)], make=Failing, sensors={"radar": None}, drives=drives)


@pytest.mark.parametrize(
    ("cause", "where", "fault"),
    [
        (np.linalg.LinAlgError("Matrix is not positive definite"), "long_run", "covariance_not_psd"),
        (np.linalg.LinAlgError("Matrix is not positive definite"), "ahead_left", "covariance_not_psd"),
        (ZeroDivisionError("float division by zero"), "stationary", "nonfinite"),
        (ValueError("math domain error"), "on_the_sensor", "nonfinite"),
        (OverflowError("too large"), "ahead_left", "nonfinite"),
        (IndexError("history"), "long_run", "exception_raised"),
        (AssertionError("gate"), "ahead_left", "exception_raised"),
        (TrackerFault("the mean has the shape (3,)"), "long_run", "invalid_estimate"),
        (TrackerFault(TOO_LARGE), "long_run", "too_far_off"),
        (TrackerFault(TOO_LARGE), "ahead_left", "invalid_estimate"),
    ],
)
def test_every_error_is_a_finding(cause: BaseException, where: str, fault: str) -> None:
    (finding,) = failure_findings(_under_test(cause, where))
    assert (finding.fault, finding.shown_by, finding.confidence) == (fault, where, 0.97)
    assert str(cause) in finding.evidence
    assert f"at 1.5 s of {where}, at a measurement of radar: radar measures range 1, azimuth 1" in finding.evidence
    assert "a missed measurement at that time breaks it too" in finding.evidence
    assert "the smallest eigenvalue of the covariance is 1 after the scan before, at 1 s" in finding.evidence


@pytest.mark.parametrize(("where", "passed"), [("on_the_sensor", None), ("long_run", False)])
def test_a_drive_past_the_sensor_that_fails_is_not_judged(
    where: str, passed: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rounding alone can break a correct filter there."""
    tracker = _under_test(np.linalg.LinAlgError("Matrix is not positive definite"), where)
    failure = tracker.failures.pop()[1]
    drive = SimpleNamespace(name=where, config=SimpleNamespace(description=where), scans=[])
    tracker.drives, tracker.output_checks = [(drive, None)], None
    tracker.once = lambda ask: ask(tracker)

    def fails(*_: Any) -> None:
        raise failure

    monkeypatch.setattr(drives, "rollout", fails)
    (check,) = drives.drives(tracker).checks
    assert check.passed is passed
    assert "failed at 1.5 s: " in check.result
    assert tracker.failures == [(where, failure)]

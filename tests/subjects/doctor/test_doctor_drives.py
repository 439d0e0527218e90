"""The judgement of the test drives, and what an examination says of itself: progress, failed steps, evidence."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import drives_of, under_test

from trackbench.subjects.doctor.checks.drives import drives
from trackbench.subjects.doctor.checks.steps import failure_findings, steps
from trackbench.subjects.doctor.drives import Rollout
from trackbench.subjects.doctor.examine import NO_PREDICTION, Doctor
from trackbench.subjects.doctor.findings import PartResult, check_named
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.report import Examination, examination_text
from trackbench.subjects.doctor.subject import SENSORS

DRIVE = "tangential_pass"
#: Standard deviations of the estimates, m and m/s.
SIGMA = np.array([0.1, 0.1, 0.5, 0.5])


def drive() -> tuple[Any, Rollout]:
    (only,) = drives_of(DRIVE)
    return only


def judged(error: Any, stated: float = 1.0) -> PartResult:
    """Estimates with errors ``(4, scans, runs)`` and ``stated`` times the standard deviations."""
    one, of_reference = drive()
    mean = one.target + error
    covariance = np.broadcast_to(np.diag((stated * SIGMA) ** 2)[:, :, None, None], (4, *mean.shape))

    class Replay:
        batched: ClassVar = True

        def step(self, state: int | None, scan: Any) -> tuple[int, Any]:
            number = 0 if state is None else state
            return number + 1, (mean[:, number], covariance[:, :, number])

    return drives(under_test(Replay, [(one, of_reference)]))


def drawn() -> Any:
    one, _ = drive()
    shape = (4, len(one.time), one.config.runs)
    return SIGMA[:, None, None] * np.random.default_rng(0).standard_normal(shape)


def test_errors_as_stated_pass() -> None:
    found = judged(drawn())
    assert found.findings == []
    assert found.checks[0].passed


def test_no_error_at_all_is_not_believable() -> None:
    """The NEES of a stated standard deviation s times the errors' is 2 / s^2."""
    (finding,) = judged(drawn(), stated=30.0).findings
    assert finding.fault == "covariance_unbelievable"
    assert finding.shown_by == DRIVE
    assert finding.factor == pytest.approx(900.0, rel=0.2)
    assert "times larger than the errors" in finding.evidence
    assert judged(drawn(), stated=4.0).findings == []


def test_small_errors_that_are_stated_smaller_are_not_believable() -> None:
    (finding,) = judged(drawn(), stated=0.1).findings
    assert finding.fault == "covariance_unbelievable"
    assert finding.factor == pytest.approx(0.01, rel=0.2)
    assert "times smaller than the errors" in finding.evidence


def test_an_estimate_that_is_far_off_is_told_with_its_time() -> None:
    one, _ = drive()
    error = drawn()
    error[0, (one.time >= 5.0) & (one.time < 6.0)] += 3.0
    found = {finding.fault: finding for finding in judged(error).findings}
    assert found["too_far_off"].shown_by == DRIVE
    assert "most from 5.0 to 6.0 s: 3" in found["too_far_off"].evidence
    assert found["too_far_off"].factor > 7.0


def test_before_a_track_has_settled_it_is_not_judged() -> None:
    one, _ = drive()
    error = drawn()
    error[:, one.time <= 3.0] *= 100.0
    assert judged(error).findings == []


class SilentAtMisses(PlainEkf):
    def step(self, state: Any, scan: Any) -> Any:
        state, answer = super().step(state, scan)
        return state, answer if scan.valid else None


class Raises(PlainEkf):
    def step(self, state: Any, scan: Any) -> Any:
        if scan.kind == "radar" and scan.time > -1.0:
            raise KeyError("rho")
        return super().step(state, scan)


class Growing:
    """At the target, with a covariance that grows at every step."""

    def step(self, state: Any, scan: Any) -> Any:
        number = 0 if state is None else state + 1
        return number, (np.zeros(4), 100.0**number * np.eye(4))


def test_a_check_without_a_prediction_points_to_no_misses() -> None:
    tracker = under_test(SilentAtMisses)
    assert tracker.silent_at_misses
    for name, names in (
        ("motion_prediction", ["prediction"]),
        ("growth_by_noise", ["process_noise", "noise_per_step"]),
    ):
        made = Doctor(SENSORS)._make_check(check_named(name), tracker)
        assert [(check.name, check.passed, check.result) for check in made.checks] == [
            (name, None, NO_PREDICTION) for name in names
        ]
    assert "--no-misses" in NO_PREDICTION
    assert not under_test(PlainEkf).silent_at_misses
    assert not under_test(SilentAtMisses, no_misses=True).silent_at_misses


def test_a_failed_step_is_a_failed_check() -> None:
    tracker = under_test(Raises)
    for name in SENSORS:
        tracker.session_at(GENERAL[0], (name,))
    made = steps(tracker)
    assert [finding.fault for finding in made.findings] == ["exception_raised"]
    assert made.checks[0].result.startswith("1 step failed, first: KeyError: 'rho' (")
    assert "Checks: 0 of 1 passed, failed:" in examination_text(Examination("mine", made.findings, made.checks))
    assert steps(under_test(PlainEkf)).checks[0].passed is True


def test_a_covariance_that_diverges_is_no_invalid_estimate() -> None:
    tracker = under_test(Growing)
    tracker.session_at(GENERAL[0], ("lidar",))
    (finding,) = failure_findings(tracker)
    assert finding.fault == "covariance_unbelievable"
    assert "its largest standard deviation has grown to 1e+09 m or m/s" in finding.evidence

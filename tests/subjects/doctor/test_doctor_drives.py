"""The judgement of the test drives: as near as the reference, and as near as stated."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from benchmarks.doctor.correct import CORRECT, UNBELIEVABLE
from tests.support.doctor import drives_of, under_test

from trackbench.subjects.doctor.checks.drives import drives
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import PartResult
from trackbench.subjects.doctor.rollout import Rollout
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


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(UNBELIEVABLE))
def test_a_tracker_with_an_unbelievable_covariance_is_not_healthy(name: str) -> None:
    doctor = Doctor(SENSORS, seed=5)
    first = drives(under_test(UNBELIEVABLE[name], doctor._drives)).findings[0]
    assert first.fault in ("too_far_off", "covariance_unbelievable")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["alpha_beta", "kf cv calm, first_measurement", "PlainEkf first_measurement"])
def test_sound_trackers_pass_every_drive(name: str) -> None:
    doctor = Doctor(SENSORS, seed=5)
    found = drives(under_test(CORRECT[name], doctor._drives))
    assert found.findings == []
    assert all(check.passed for check in found.checks)

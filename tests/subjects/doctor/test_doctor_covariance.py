"""The covariance that a tracker returns, its process noise, and the gains that go with them."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import Make, under_test

from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.one_gain import one_gain
from trackbench.subjects.doctor.checks.process_noise import noise_powers
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.subject import SENSORS


class ThreeTimes(PlainEkf):
    """Moves the mean three times by one measurement."""

    def update(self, x, P, scan):
        first, after = super().update(x, P, scan)
        second, _ = super().update(first, P, scan)
        return super().update(second, P, scan)[0], after


def test_a_measurement_that_is_applied_three_times_is_told_so() -> None:
    lidar, radar = one_gain(under_test(ThreeTimes)).findings
    assert {lidar.fault, radar.fault} == {"gain_inconsistent"}
    assert lidar.factor == radar.factor == 3.0
    assert "3 updates with the same measurement" in lidar.evidence


class Inflated(PlainEkf):
    """A fading memory: the covariance is multiplied after each update."""

    def corrected_covariance(self, P, K, S):
        return 1.05 * super().corrected_covariance(P, K, S)


class OwnGain(PlainEkf):
    """A larger gain than the optimal one, with the covariance that it leaves."""

    times = 1.3

    def corrected_mean(self, x, K, y):
        return x + self.times * K @ y

    def corrected_covariance(self, P, K, S):
        return P - K @ S @ K.T + (self.times - 1) ** 2 * K @ S @ K.T


class LargerGain(OwnGain):
    times = 1.6


class DiagonalInnovation(PlainEkf):
    """Each component of the measurement has the gain that it had alone."""

    def update(self, x, P, scan):
        H = self.sensor_jacobian(x, scan)
        R = self.noise(scan)
        K = P @ H.T / np.diag(H @ P @ H.T + R)
        kept = np.eye(4) - K @ H
        return x + K @ self.innovation(scan, self.predicted_measurement(x, scan)), kept @ P @ kept.T + K @ R @ K.T


def test_a_gain_with_its_own_covariance_is_no_wrong_jacobian() -> None:
    tracker = under_test(LargerGain)
    lidar, radar = one_gain(tracker).findings
    assert {lidar.fault, radar.fault} == {"gain_inconsistent"}
    assert lidar.factor == pytest.approx(1.6, rel=1e-6)
    assert "the covariance after it is that of this gain" in lidar.evidence
    assert gain(tracker).findings == []
    for finding in one_gain(under_test(DiagonalInnovation)).findings:
        assert finding.fault == "gain_inconsistent"
        assert "of the diagonal of the innovation covariance alone" in finding.evidence


@pytest.mark.parametrize("make", [Inflated, OwnGain], ids=lambda make: make.__name__)
def test_a_consistent_update_has_no_finding(make: Make) -> None:
    assert one_gain(under_test(make)).findings == []


class Continuous(PlainEkf):
    """A white acceleration in continuous time."""

    def process_noise(self, x, dt):
        return 0.5 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))


class OneAxis(Continuous):
    """With dt^4 / 4 for the position along y."""

    def process_noise(self, x, dt):
        noise = super().process_noise(x, dt)
        noise[1, 1] = 0.5 * dt**4 / 4
        return noise


def test_the_powers_of_the_time_step() -> None:
    """dt^4, dt^3, dt^2 of an acceleration that is constant over a step; dt^3, dt^2, dt of a continuous one."""
    (check,) = noise_powers(under_test(PlainEkf)).checks
    assert check.passed
    assert "grow with dt^4, dt^3, dt^2" in check.result
    (check,) = noise_powers(under_test(Continuous)).checks
    assert check.passed
    assert "grow with dt^3, dt^2, dt^1" in check.result
    (finding,) = noise_powers(under_test(OneAxis)).findings
    assert finding.fault == "q_wrong_power_of_dt"
    assert "of py grows with dt^4" in finding.evidence
    assert "where dt^3 goes" in finding.evidence


class Template:
    """Constant gains and a constant covariance, as in a tracker that is only begun."""

    def step(self, state, scan):
        inner = PlainEkf() if state is None else state[0]
        kept, answer = inner.step(None if state is None else state[1], scan)
        return (inner, kept), None if answer is None else (answer[0], np.diag([1.0, 1.0, 9.0, 9.0]))


@pytest.mark.slow
def test_checks_of_a_covariance_that_is_not_the_own_one_are_not_made() -> None:
    found = Doctor(SENSORS).examine("begun", Template)
    assert found.findings[0].fault == "covariance_constant"
    assert {finding.fault for finding in found.findings if finding.consequence_of is None} == {"covariance_constant"}
    results = {check.name: check for check in found.checks}
    for name in ("start_confidence", "process_noise", "gain.radar", "one_gain.lidar"):
        assert results[name].passed is None
        assert "not the tracker's own" in results[name].result
    skipped = Doctor(SENSORS, skip=["stated_covariance"]).examine("begun", Template)
    assert next(check for check in skipped.checks if check.name == "process_noise").passed is False

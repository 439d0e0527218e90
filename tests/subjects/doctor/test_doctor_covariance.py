"""The covariance that a tracker returns, its process noise, and the gains that go with them."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import Make, under_test

from trackbench.subjects.doctor.checks.equations import equations
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import PROVEN
from trackbench.subjects.doctor.subject import SENSORS


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


def test_a_gain_with_its_own_covariance_is_no_wrong_jacobian() -> None:
    tracker = under_test(LargerGain)
    lidar, radar = equations(tracker).findings
    assert {lidar.fault, radar.fault} == {"gain_inconsistent"}
    assert lidar.factor == pytest.approx(1.6, rel=1e-6)
    assert gain(tracker).findings == []


class NoiseTwice(PlainEkf):
    """Adds R to the innovation covariance in two places."""

    def update(self, x, P, scan):
        H, R = self.sensor_jacobian(x, scan), self.noise(scan)
        S = H @ P @ H.T + 2 * R
        K = P @ H.T @ np.linalg.inv(S)
        y = self.innovation(scan, self.predicted_measurement(x, scan))
        return x + K @ y, self.corrected_covariance(P, K, S)


def test_a_measurement_noise_that_is_added_twice_is_told_so() -> None:
    lidar, radar = equations(under_test(NoiseTwice)).findings
    assert {lidar.fault, radar.fault} == {"r_too_large"}
    assert {lidar.factor, radar.factor} == {2.0}
    assert lidar.confidence == PROVEN
    assert "R is added 2 times" in lidar.evidence


class PredictedNoiseTwice(PlainEkf):
    """Adds Q to the predicted covariance in two places."""

    def predict(self, x, P, dt):
        x, P = super().predict(x, P, dt)
        return x, P + self.process_noise(x, dt)


def test_a_process_noise_that_is_added_twice_is_told_so() -> None:
    (finding,) = equations(under_test(PredictedNoiseTwice)).findings
    assert finding.fault == "process_noise_twice"
    assert "2 times" in finding.evidence


class LouderNoise(PlainEkf):
    """States ten times the variances of the sensors."""

    def noise(self, scan):
        return 10 * super().noise(scan)


def test_a_noise_that_differs_from_the_stated_one_is_shown_with_its_line() -> None:
    lidar, radar = equations(under_test(LouderNoise)).findings
    assert {lidar.fault, radar.fault} == {"r_too_large"}
    assert lidar.factor == pytest.approx(10.0)
    assert "test_doctor_covariance.py:" in lidar.evidence
    assert "0.474, 0.474, and lidar states 0.15, 0.15" in lidar.evidence


class LosesMean(PlainEkf):
    """Returns the updated mean, and goes on from the predicted one."""

    def step(self, state, scan):
        after, answer = super().step(state, scan)
        if state is not None:
            after = after._replace(mean=self.predict(state.mean, state.covariance, scan.time - state.time)[0])
        return after, answer


def test_an_update_that_is_not_kept_is_told_so() -> None:
    lidar, radar = equations(under_test(LosesMean)).findings
    assert {lidar.fault, radar.fault} == {"update_not_kept"}
    assert "0% of its change of the mean is left" in lidar.evidence


@pytest.mark.parametrize("make", [Inflated, OwnGain], ids=lambda make: make.__name__)
def test_a_consistent_update_has_no_finding(make: Make) -> None:
    assert equations(under_test(make)).findings == []


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
    for name in ("start_confidence", "process_noise", "gain.radar"):
        assert results[name].passed is None
        assert "not the tracker's own" in results[name].result
    skipped = Doctor(SENSORS, skip=["stated_covariance"]).examine("begun", Template)
    assert next(check for check in skipped.checks if check.name == "process_noise").passed is False

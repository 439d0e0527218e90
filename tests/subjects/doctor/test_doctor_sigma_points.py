"""The expected gains of a trial, sigma points, samples and units in the checks of the doctor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import program_under_test, under_test

from trackbench.base.types import Estimate
from trackbench.subjects.doctor.checks.prediction import motion_prediction
from trackbench.subjects.doctor.checks.validity import repeatability
from trackbench.subjects.doctor.expected_gain import gain_error, gaussian_gain, linearised_gain
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.samples import has_samples, sampling_noise
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import learned_offsets, linearises
from trackbench.subjects.doctor.trial import Trial


@pytest.mark.parametrize(("name", "expected"), [("plain_ekf", True), ("ukf_cv", False)])
def test_an_ekf_predicts_the_measurement_of_its_mean(name: str, expected: bool) -> None:
    assert program_under_test(name).once(linearises) is expected


def _trial(mean, covariance, kind: str = "radar") -> Trial:
    scan = GENERAL[0].scan(kind, SENSORS[kind], 0.0)
    return Trial("", "", scan, Estimate(np.array(mean), np.array(covariance)), TrackerSession(PlainEkf))


def test_both_expected_gains_are_the_kalman_gain_of_a_linear_measurement() -> None:
    covariance = np.diag([2.0, 1.0, 3.0, 3.0])
    trial = _trial([18.0, 13.0, -4.0, 9.0], covariance, "lidar")
    right = np.vstack([np.diag([2.0 / (2.0 + 0.15**2), 1.0 / (1.0 + 0.15**2)]), np.zeros((2, 2))])
    np.testing.assert_allclose(linearised_gain(trial), right, atol=1e-12)
    np.testing.assert_allclose(gaussian_gain(trial), right, atol=1e-12)
    assert gain_error(trial, 0.9 * right)[0] == pytest.approx(0.1)


def test_the_moments_of_the_range_across_the_line_of_sight() -> None:
    """At px = r with a variance s^2 of py alone, the range has the variance s^4 / (2 r^2) to lowest order."""
    trial = _trial([1000.0, 0.0, 0.0, 0.0], np.diag([1e-12, 400.0, 1e-12, 1e-12]))
    assert trial.second_order[0] == pytest.approx(400.0 / 2000.0, rel=1e-3)
    assert trial.curvature[0] * trial.sigma[0] == pytest.approx(400.0 / (np.sqrt(2) * 1000.0), rel=1e-3)


class Drawn(PlainEkf):
    """Its mean has the noise of a few samples, from a generator of its own."""

    random = True

    def __init__(self, size: float = 0.05) -> None:
        super().__init__()
        self.size, self.generator = size, np.random.default_rng(3)

    def predict(self, x: Any, P: Any, dt: float) -> Any:
        x, P = super().predict(x, P, dt)
        return x + self.size * np.linalg.cholesky(P) @ self.generator.standard_normal(4), P


class Unseeded(Drawn):
    def __init__(self) -> None:
        super().__init__()
        self.generator = np.random.default_rng()


class Undeclared(Unseeded):
    random = False


def test_a_filter_that_says_that_it_draws_may_draw() -> None:
    assert repeatability(under_test(Unseeded)).findings == []
    (finding,) = repeatability(under_test(Undeclared)).findings
    assert finding.fault == "not_deterministic"


def test_samples_are_seen_in_the_answers() -> None:
    assert has_samples(under_test(Drawn))
    assert 0.003 < under_test(Drawn, sensors={"lidar": SENSORS["lidar"]}).once(sampling_noise) < 0.5
    assert under_test(PlainEkf).once(sampling_noise) == 0.0


class WithBias(PlainEkf):
    """Estimates a constant error of the range beside its state."""

    def step(self, state: Any, scan: Any) -> Any:
        track, bias = (None, 0.0) if state is None else state
        if scan.kind == "radar" and scan.valid and track is not None:
            error = np.array([bias, 0.0, 0.0])
            x, _ = self.predict(track.mean, track.covariance, scan.time - track.time)
            left = scan.measurement - error - self.predicted_measurement(x, scan)
            bias, scan = bias + 0.1 * left[0], scan._replace(measurement=scan.measurement - error)
        track, estimate = super().step(track, scan)
        return (track, bias), estimate


def test_a_constant_error_that_a_tracker_estimates_is_known() -> None:
    assert learned_offsets(under_test(WithBias), "radar") == ["range"]
    assert learned_offsets(under_test(PlainEkf), "radar") == []


def test_a_time_step_in_milliseconds_is_said_as_such() -> None:
    (finding,) = motion_prediction(program_under_test("milliseconds_of_milliseconds")).findings
    assert finding.fault == "wrong_dt"
    assert "milliseconds and seconds are confused" in finding.evidence

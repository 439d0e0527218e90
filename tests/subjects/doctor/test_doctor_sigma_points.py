"""Sigma points, samples and units in the checks of the doctor."""

from __future__ import annotations

from functools import partial
from math import pi

import numpy as np
import pytest
from benchmarks.doctor.correct import OTHERS
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.doctor.sampling_filters import EnsembleFilter, ParticleFilter
from tests.support.doctor import correct_under_test, mutant_under_test, under_test

from trackbench.base.types import Estimate
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.prediction import motion_prediction
from trackbench.subjects.doctor.checks.sigma_points import no_time
from trackbench.subjects.doctor.checks.validity import repeatability
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.expected_gain import gain_error, gaussian_gain, linearised_gain
from trackbench.subjects.doctor.findings import rank_findings
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.samples import sampling_noise
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.subjects.doctor.tracker_under_test import learned_offsets, linearises
from trackbench.subjects.doctor.trial import Trial
from trackbench.subjects.doctor.units_ratio import conversion


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("sigma_weights_wrong/plain_ukf/equal", 1.1),
        ("sigma_weights_wrong/plain_ukf/centre_left_out", 5 / 3),
        ("sigma_weights_wrong/filterpy_ukf/covariance_weights_for_mean", 3.0),
        ("sigma_spread_wrong/plain_ukf/other_kappa", 3 / 5),
        ("sigma_spread_wrong/plain_ukf/spread_forgotten", 1 / 5),
        ("sigma_spread_wrong/filterpy_ukf/root_forgotten", 5.0),
    ],
)
def test_a_prediction_over_no_time_shows_the_sums_of_the_weights(name: str, factor: float) -> None:
    """The sum of the mean's weights, and the ratio of n + lambda of the points to that of the weights."""
    (finding,) = no_time(mutant_under_test(name)).findings
    assert finding.fault == name.split("/")[0]
    assert finding.factor == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize(
    "name", ["PlainEkf first_measurement", "PlainUkf first_measurement", "ensemble", "range bias", "imm"]
)
def test_nothing_happens_over_no_time_to_a_sound_tracker(name: str) -> None:
    result = no_time(correct_under_test(name))
    assert result.findings == []
    assert result.checks[0].passed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("gain_inconsistent/plain_ukf/other_kappa_in_update", "gain_inconsistent"),
        ("sigma_points_not_redrawn/plain_ukf/update", "sigma_points_not_redrawn"),
        ("measurement_noise_twice/plain_ukf/update", "measurement_noise_twice"),
    ],
)
def test_a_wrong_gain_of_sigma_points_is_no_wrong_jacobian(name: str, fault: str) -> None:
    found = rank_findings(gain(mutant_under_test(name)).findings)
    assert found[0].fault == fault
    assert "jacobian_wrong" not in {finding.fault for finding in found}


@pytest.mark.parametrize("name", ["angle_mean_not_circular/plain_ukf/mean", "azimuth_not_wrapped/plain_ukf/residual"])
def test_a_plain_mean_of_azimuths_is_told_from_a_plain_innovation(name: str) -> None:
    found = rank_findings(wrapping(mutant_under_test(name)).findings)
    assert found[0].fault == name.split("/")[0]


@pytest.mark.parametrize(("make", "expected"), [(PlainEkf, True), (PlainUkf, False), (OTHERS["imm"], True)])
def test_an_ekf_predicts_the_measurement_of_its_mean(make, expected: bool) -> None:
    assert under_test(make).once(linearises) is expected


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


@pytest.mark.parametrize(("name", "learned"), [("range bias", ["range"]), ("information filter", [])])
def test_a_constant_error_that_a_tracker_estimates_is_known(name: str, learned: list[str]) -> None:
    assert learned_offsets(correct_under_test(name), "radar") == learned


def test_a_filter_that_says_that_it_draws_may_draw() -> None:
    few = type("Few", (EnsembleFilter,), {"count": 200})
    silent = type("Silent", (few,), {"random": False})
    assert repeatability(under_test(few)).findings == []
    (finding,) = repeatability(under_test(silent)).findings
    assert finding.fault == "not_deterministic"


def test_sampling_noise_is_seen_of_a_seeded_filter() -> None:
    """The mean of N samples has the standard error N^-1/2; a Kalman filter has none."""
    few = type("Few", (ParticleFilter,), {"count": 500})
    noise = under_test(partial(few, seed=1), sensors={"lidar": SENSORS["lidar"]}).once(sampling_noise)
    assert 0.3 / np.sqrt(500) < noise < 10 / np.sqrt(500)
    assert under_test(PlainEkf).once(sampling_noise) == 0.0


def test_a_velocity_in_kilometres_per_hour_is_said_as_such() -> None:
    (finding,) = motion_prediction(mutant_under_test("velocity_unit/plain_ekf/kmh")).findings
    assert finding.fault == "velocity_unit"
    assert finding.factor == pytest.approx(3.6, rel=1e-3)
    assert "km/h for m/s" in finding.evidence


def test_a_time_step_in_milliseconds_is_said_as_such() -> None:
    (finding,) = motion_prediction(mutant_under_test("wrong_dt/plain_ekf/milliseconds")).findings
    assert finding.fault == "wrong_dt"
    assert "milliseconds and seconds are confused" in finding.evidence


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("degrees_for_radians/plain_ekf/sigma_in_degrees", "degrees_for_radians"),
        ("jacobian_wrong/plain_ekf/azimuth_in_degrees", "jacobian_wrong"),
    ],
)
def test_degrees_in_the_noise_and_in_a_row_are_said_as_such(name: str, fault: str) -> None:
    first = gain(mutant_under_test(name)).findings[0]
    assert first.fault == fault
    assert "180/pi" in first.evidence


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (180 / pi, "degrees for radians (180/pi = 57.3)"),
        (pi / 180, "radians for degrees (pi/180 = 0.01745)"),
        (3.6, "km/h for m/s (3.6)"),
        (1 / 3.6, "m/s for km/h (1/3.6 = 0.2778)"),
        (3.28084, "feet for metres (3.281)"),
        (3600 / 1609.344, "miles per hour for m/s (2.237)"),
    ],
)
def test_a_ratio_is_said_as_what_it_is(ratio: float, words: str) -> None:
    found = conversion(ratio)
    assert found is not None
    assert found.words == words
    assert found.exact == pytest.approx(ratio, rel=1e-5)


@pytest.mark.parametrize("ratio", [1.0, 2.0, 57.3 * 1.05, 1.8, 0.0, -3.6, float("nan"), float("inf")])
def test_another_ratio_is_no_unit(ratio: float) -> None:
    assert conversion(ratio) is None

"""The examination of a tracker: no finding for correct ones, and the right first finding for injected faults."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from benchmarks.doctor.faults import CORRECT, MUTANTS
from tests.support.doctor import under_test
from tests.support.places import ROOT

from trackbench.base.types import Estimate
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.jacobians import provided_jacobians
from trackbench.subjects.doctor.drives import drive_configs
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import (
    CHECKS,
    faults_of,
)
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.session import TrackerSession
from trackbench.subjects.doctor.subject import SENSORS, subject
from trackbench.trackers.builtin import ekf

REPOSITORY = ROOT
NAMES = [
    *("ego_motion_wrong", "predicted_covariance_wrong", "q_depends_on_state"),
    *("wrong_covariance_returned", "imm_combination_wrong", "imm_likelihood_wrong", "imm_mixing_wrong"),
    *("imm_models_equal", "imm_transition_transposed", "azimuth_not_wrapped", "angle_mean_not_circular"),
    *("course_not_wrapped", "arctan_quadrant", "jacobian_wrong", "gain_inconsistent", "sigma_weights_wrong"),
    *("sigma_spread_wrong", "sigma_points_misdrawn", "sigma_points_not_redrawn", "doppler_sign"),
    *("speed_for_range_rate", "degrees_for_radians", "velocity_unit", "wrong_dt", "missed_scan_not_predicted"),
    *("time_offset", "velocity_not_kept", "q_too_small"),
    *("q_too_large", "q_constant_per_step", "q_wrong_power_of_dt", "process_noise_omitted", "process_noise_twice"),
    *("r_too_small", "r_too_large", "measurement_noise_omitted", "measurement_noise_twice", "overconfident_start"),
    *("polar_start", "covariance_asymmetric", "predicted_covariance_asymmetric", "covariance_not_psd"),
    *("predicted_covariance_not_psd", "covariance_not_reduced", "update_not_kept", "covariance_update_wrong"),
    *("covariance_constant", "covariance_diagonal", "covariance_order", "integer_state_matrix", "sensor_bias"),
    *("scale_error", "axis_swapped", "axis_mirrored", "ego_motion_ignored", "sensor_pose_ignored"),
    *("measurement_ignored", "nonfinite", "exception_raised", "invalid_estimate"),
    *("process_ended", "not_deterministic", "too_far_off", "covariance_unbelievable"),
]
#: Found in other trackers.
ELSEWHERE = (
    "sensor_pose_ignored",  # needs a sensor that stands still: test_doctor_assumptions.py
    # of several models: test_doctor_modes.py
    *(
        "imm_combination_wrong",
        "imm_likelihood_wrong",
        "imm_mixing_wrong",
        "imm_models_equal",
        "imm_transition_transposed",
    ),
    *("invalid_estimate", "process_ended"),  # test_doctor_failures.py
    *("too_far_off", "covariance_unbelievable"),  # of no other name: test_doctor_drives.py
    *(
        "course_not_wrapped",
        "angle_mean_not_circular",
    ),  # of sigma points: test_doctor_steps.py, test_doctor_failures.py
    *("sigma_weights_wrong", "sigma_spread_wrong", "sigma_points_misdrawn"),  # test_doctor_sigma_points.py
    *("sigma_points_not_redrawn", "gain_inconsistent"),
    # test_doctor_covariance.py
    *("covariance_update_wrong", "covariance_constant", "covariance_diagonal", "covariance_order"),
    "q_wrong_power_of_dt",
    *("measurement_noise_omitted", "measurement_noise_twice", "process_noise_omitted"),
)


@pytest.fixture(scope="module")
def doctor() -> Doctor:
    # That drive takes as long as all others.
    return Doctor(SENSORS, skip=("long_run",))


def _first(fault: str, kind: str):
    return next(mutant for mutant in MUTANTS if mutant.fault == fault and mutant.subject == kind)


@pytest.mark.parametrize("fault", [name for name in NAMES if name not in ELSEWHERE])
def test_an_injected_fault_has_the_right_name_first(doctor: Doctor, fault: str) -> None:
    mutant = _first(fault, "plain_ekf")
    found = doctor.examine(mutant.name, mutant.make)
    assert found.findings
    first = found.findings[0]
    assert first.fault == fault
    assert first.consequence_of is None
    assert any(character.isdigit() for character in first.evidence)
    if mutant.factor is not None:
        assert first.sensor == mutant.sensor
        assert 0.5 < first.factor / mutant.factor < 2.0


@pytest.mark.parametrize(
    "name",
    [
        "PlainEkf first_measurement",
        pytest.param("FilterPyUkf two_measurements", marks=pytest.mark.slow),
        "kf ca calm, two_measurements",
        pytest.param("ukf ctrv lively, first_measurement", marks=pytest.mark.slow),
        pytest.param("ekf ctra usual, two_measurements", marks=pytest.mark.slow),
        "alpha_beta",
    ],
)
def test_a_correct_tracker_has_nothing(name: str) -> None:
    found = Doctor(SENSORS, seed=5).examine(name, CORRECT[name])
    assert found.findings == []
    assert found.healthy, [check for check in found.checks if check.passed is False]


def test_every_fault_has_a_fix_and_a_drive() -> None:
    faults = faults_of(CHECKS)
    assert sorted(faults) == sorted(NAMES)
    assert {fault.role.drive for fault in faults.values()} <= set(drive_configs())


def test_gains_imply_the_noise_of_a_linear_filter() -> None:
    """The factor is the ratio of the used to the stated variance."""

    class Halved:
        batched = True
        tracker = ekf(motion="cv", acceleration_sigma_mps2=3.0)

        def step(self, state, scan):
            return self.tracker.step(state, scan._replace(noise_covariance=scan.noise_covariance * 0.4))

    tracker = under_test(Halved)
    found = gain(tracker).findings
    assert {(finding.fault, finding.sensor) for finding in found} == {
        ("r_too_small", "lidar"),
        ("r_too_small", "radar"),
    }
    for one in found:
        assert one.factor == pytest.approx(0.4, rel=1e-3)


@pytest.mark.parametrize(
    "name", ["PlainEkf first_measurement", "FilterPyEkf first_measurement", "ekf cv calm, first_measurement"]
)
def test_peek_changes_nothing(name: str) -> None:
    """Also of a tracker that keeps its state in itself."""
    make, probe, sensor = CORRECT[name], GENERAL[0], SENSORS["lidar"]
    peeked, left = TrackerSession(make), TrackerSession(make)
    for k in range(6):
        scan = probe.scan("lidar", sensor, 0.1 * k)
        if k:
            peeked.peek(empty_scan(scan))
            peeked.peek(scan._replace(measurement=scan.measurement + 3.0))
        one, other = peeked.step(scan), left.step(scan)
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.mean, other.mean)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_provided_jacobian_is_compared_with_its_model() -> None:
    class Provided:
        def __init__(self, slip: float) -> None:
            self.slip = slip

        def step(self, state, scan):
            x = np.array([1.0, 2.0, 3.0, 4.0])
            return 1, Estimate(x, np.eye(4), state=x)

        def transition(self, x, dt):
            return np.array([x[0] + dt * x[2] ** 2, x[1], x[2], x[3]])

        def transition_jacobian(self, x, dt):
            matrix = np.eye(4)
            matrix[0, 2] = 2 * dt * x[2] + self.slip
            return matrix

    tracker = under_test(lambda: Provided(0.0), sensors={"lidar": SENSORS["lidar"]})
    assert provided_jacobians(tracker).findings == []
    tracker = under_test(lambda: Provided(0.1), sensors={"lidar": SENSORS["lidar"]})
    (finding,) = provided_jacobians(tracker).findings
    assert finding.fault == "jacobian_wrong"
    assert "transition[0] / d x[2] = 0.7, where 0.6 is right" in finding.evidence


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["lidar", "radar"])
def test_the_process_noise_is_judged_by_sensors_that_are_read(doctor: Doctor, kind: str) -> None:
    """9 m/s^2 fit a road vehicle at 20 steps a second; over 1 s at once, as where it is only asked, they would not."""
    other = "radar" if kind == "lidar" else "lidar"
    make = partial(ekf, motion="cv", acceleration_sigma_mps2=9.0, sensors=[kind])
    found = doctor.examine("one_sensor", make)
    assert [(finding.fault, finding.sensor) for finding in found.findings] == [("measurement_ignored", other)]


def test_the_same_seed_gives_the_same_examination() -> None:
    first, second = (Doctor(SENSORS, seed=3).examine("alpha_beta", CORRECT["alpha_beta"]).json() for _ in range(2))
    assert first == second


def test_sensors_have_no_effects_in_an_examination(tiny_text: str, tmp_path: Path) -> None:
    effects = "effects: [{type: bias, sigmas: {range_m: 1}}]"
    text = tiny_text.replace("range_rate_sigma_mps: 0.1}", f"range_rate_sigma_mps: 0.1, {effects}}}")
    first = "initial: {from: two_measurements, least_time_s: 0}"
    text = text.replace(first, "assume: {radar: {bias: {sigmas: {range_m: 1}}}}")
    (tmp_path / "biased.yaml").write_text(text)
    found = subject(f"{tmp_path / 'biased.yaml'}#ekf", {})
    assert Doctor(found.sensors).sensors["radar"].effects == []
    assert "assumes none" in found.notes[0]
    probe = GENERAL[0]
    scans = [probe.scan("radar", found.sensors["radar"], 0.1 * number) for number in range(5)]
    ends = []
    for make in (found.make, lambda: ekf(motion="cv", acceleration_sigma_mps2=3)):
        session = TrackerSession(make)
        ends.append([session.step(scan) for scan in scans][-1])
    assert ends[0] is not None
    assert ends[1] is not None
    np.testing.assert_array_equal(ends[0].mean, ends[1].mean)


def test_the_tracker_of_a_scenario_is_examined_with_the_sensors_that_it_uses() -> None:
    found = subject(f"{REPOSITORY}/scenarios/scripted/own_model.yaml#kf_lidar", {})
    assert list(found.sensors) == ["lidar"]
    assert found.notes

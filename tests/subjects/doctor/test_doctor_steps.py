"""Faults of single steps, and late measurements: each is named by the check that looks for it, and by no other."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from benchmarks.doctor.faults import CORRECT
from tests.support.doctor import Make, Part, correct_under_test, mutant, mutant_under_test, under_test

from trackbench.subjects.doctor.checks.covariance_update import continuity, covariance_update
from trackbench.subjects.doctor.checks.expectation import expectation
from trackbench.subjects.doctor.checks.output import integers
from trackbench.subjects.doctor.checks.prediction import motion_prediction
from trackbench.subjects.doctor.checks.process_noise import growth_by_noise
from trackbench.subjects.doctor.checks.validity import validity
from trackbench.subjects.doctor.checks.velocity import velocity
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.trackers.builtin import ekf

PARTS: dict[Part, list[str]] = {
    continuity: ["update_not_kept/covariance", "update_not_kept/mean"],
    covariance_update: ["covariance_not_reduced/update", "covariance_not_reduced/radar", "process_noise_twice/update"],
    expectation: ["scale_error/range_1.02", "scale_error/lidar_0.97", "time_offset/predicted_later"],
    integers: ["integer_state_matrix/state", "integer_state_matrix/covariance", "integer_state_matrix/start"],
    motion_prediction: ["missed_scan_not_predicted/skipped", "missed_scan_not_predicted/time_stored"],
    growth_by_noise: ["q_constant_per_step/0.1", "q_constant_per_step/0.05"],
    validity: ["predicted_covariance_not_psd/correlation_beyond_one"],
    velocity: ["velocity_not_kept/prediction", "velocity_not_kept/update"],
}
FAULTY = [(part, name) for part, names in PARTS.items() for name in names]


def of_ekf(name: str) -> str:
    """The name of an injected fault of the plain EKF."""
    return name.replace("/", "/plain_ekf/")


@pytest.mark.parametrize(("part", "name"), FAULTY, ids=lambda value: getattr(value, "__name__", value))
def test_a_fault_of_a_step_is_named(part: Part, name: str) -> None:
    injected, found = mutant(of_ekf(name)), part(mutant_under_test(of_ekf(name))).findings
    assert {finding.fault for finding in found} == {injected.fault}
    if injected.fault in ("covariance_not_reduced", "scale_error"):
        assert {one.sensor for one in found} <= {injected.sensor} if injected.sensor else set(SENSORS)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.__name__)
def test_a_sound_tracker_has_none(part: Part) -> None:
    found = part(correct_under_test("PlainEkf first_measurement"))
    assert found.findings == []
    assert all(check.passed for check in found.checks)


IMM = {
    "imm": [{"model": "cv", "acceleration_sigma_mps2": 0.5}, {"model": "ca", "jerk_sigma_mps3": 19.0}],
    "stay_s": [13.0, 10.0],
}
OTHERS: dict[str, Make] = {
    **{name: CORRECT[name] for name in ("alpha_beta", "FilterPyUkf first_measurement")},
    **{name: CORRECT[name] for name in ("ekf ctra usual, two_measurements", "ckf ctrv usual, first_measurement")},
    **{name: CORRECT[name] for name in ("ukf ctrv classic, two_measurements", "ckf ctrv calm, first_measurement")},
    **{name: CORRECT[name] for name in ("kf cv calm, first_measurement", "ukf ctra lively, first_measurement")},
    "imm": partial(ekf, motion=IMM),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_other_motion_models_and_filters_have_none(name: str) -> None:
    tracker = under_test(OTHERS[name])
    found = [one for part in (*PARTS, wrapping) for one in part(tracker).findings]
    assert found == []


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["spread", "mean"])
def test_a_course_that_is_not_wrapped_is_named(variant: str) -> None:
    found = wrapping(mutant_under_test(f"course_not_wrapped/plain_ukf/{variant}")).findings
    assert {finding.fault for finding in found} == {"course_not_wrapped"}


@pytest.mark.parametrize("variant", ["rate_velocity_swapped", "azimuth_in_degrees"])
def test_a_wrong_jacobian_is_no_angle_that_is_not_wrapped(variant: str) -> None:
    """With the velocities' entries swapped the track of the target with the course pi diverges."""
    assert wrapping(mutant_under_test(f"jacobian_wrong/plain_ekf/{variant}")).findings == []


def test_process_noise_that_is_added_twice_in_a_turning_model_is_named() -> None:
    (radar, lidar) = covariance_update(mutant_under_test("process_noise_twice/plain_ukf/update")).findings
    assert {radar.fault, lidar.fault} == {"process_noise_twice"}
    assert radar.factor == pytest.approx(2.0, abs=0.01)
    assert lidar.factor == pytest.approx(2.0, abs=0.01)


def test_the_factor_of_a_scale_is_that_of_the_measurements() -> None:
    (finding,) = expectation(mutant_under_test(of_ekf("scale_error/range_1.02"))).findings
    assert finding.factor == pytest.approx(1.02, abs=1e-3)
    assert "range times 1.02" in finding.evidence


def test_a_delay_is_told_in_milliseconds() -> None:
    (finding,) = expectation(mutant_under_test(of_ekf("time_offset/predicted_later"))).findings
    assert "50 ms after" in finding.evidence


def test_a_constant_covariance_is_none_of_a_filter_that_forgets_to_reduce_it() -> None:
    class Fixed:
        """An estimate with fixed gains, that states the same covariance always."""

        batched = False

        def step(self, state, scan):
            inner = CORRECT["alpha_beta"]() if state is None else state[0]
            kept, answer = inner.step(None if state is None else state[1], scan)
            return (inner, kept), (answer[0], np.diag([0.04, 0.04, 1.0, 1.0]))

    tracker = under_test(Fixed)
    assert covariance_update(tracker).findings == []
    assert integers(tracker).findings == []

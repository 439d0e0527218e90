"""Faults as people make them, each named by the part of the examination that looks for it; sound trackers by none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.other_ekfs import AdaptiveEkf
from benchmarks.doctor.people_faults import TurningEkf
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.faults.corpus import Program, bases, faults, sound
from tests.support.doctor import (
    Make,
    Part,
    drives_of,
    mutant,
    mutant_under_test,
    program_named,
    tracker_of,
    under_test,
)

from trackbench.subjects.doctor.checks.drives import drives, harmless
from trackbench.subjects.doctor.checks.expectation import expectation
from trackbench.subjects.doctor.checks.gain import gain
from trackbench.subjects.doctor.checks.modes import modes
from trackbench.subjects.doctor.checks.one_gain import one_gain
from trackbench.subjects.doctor.checks.prediction import motion_prediction, spreading
from trackbench.subjects.doctor.checks.process_noise import growth_by_noise, noise_powers
from trackbench.subjects.doctor.checks.sigma_points import no_time
from trackbench.subjects.doctor.checks.start import first_position
from trackbench.subjects.doctor.checks.stated_covariance import stated_covariance
from trackbench.subjects.doctor.checks.transition import noise_place, transition
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.expected_gain import implied
from trackbench.subjects.doctor.samples import OTHER_ANSWERS, has_samples

FAULTY: list[tuple[Part, str]] = [
    (one_gain, "covariance_update_wrong/plain_ekf/in_place"),
    (motion_prediction, "wrong_dt/plain_ekf/whole_seconds"),
    (motion_prediction, "wrong_dt/plain_ekf/tenths"),
    (motion_prediction, "wrong_dt/plain_ekf/at_most_0.2"),
    (motion_prediction, "wrong_dt/plain_ekf/missed_not_stored"),
    (expectation, "ego_motion_wrong/plain_ekf/added"),
    (expectation, "ego_motion_wrong/plain_ekf/boresight"),
    (expectation, "ego_motion_wrong/plain_ekf/turned_other_way"),
    (expectation, "measurement_ignored/plain_ekf/lidar_y"),
    (stated_covariance, "wrong_covariance_returned/plain_ekf/noise"),
    (stated_covariance, "wrong_covariance_returned/plain_ekf/precision"),
    (transition, "predicted_covariance_wrong/plain_ekf/transition_alone"),
    (transition, "predicted_covariance_wrong/plain_ukf/about_old_mean"),
    (transition, "jacobian_wrong/turning_ekf/after_the_move"),
    (transition, "jacobian_wrong/turning_ekf/turn_rate_ignored"),
    (noise_place, "q_depends_on_state/plain_ekf/px"),
    (growth_by_noise, "process_noise_omitted/plain_ukf/prediction"),
    (no_time, "measurement_noise_omitted/plain_ukf/update"),
    (no_time, "sigma_points_misdrawn/plain_ukf/rows_for_columns"),
    (no_time, "sigma_points_misdrawn/filterpy_ukf/rows_for_columns"),
]


@pytest.mark.parametrize(("part", "name"), FAULTY, ids=lambda value: getattr(value, "__name__", value))
def test_a_fault_is_named(part: Part, name: str) -> None:
    injected, found = mutant(name), part(mutant_under_test(name)).findings
    assert {finding.fault for finding in found} == {injected.fault}
    assert injected.sensor is None or {one.sensor for one in found} == {injected.sensor}


@pytest.mark.parametrize("make", [PlainEkf, PlainUkf, TurningEkf, AdaptiveEkf])
def test_a_sound_tracker_has_none(make: Callable[[], Any]) -> None:
    tracker = under_test(make)
    for part in (transition, noise_place, stated_covariance):
        result = part(tracker)
        assert result.findings == []
        assert all(check.passed is not False for check in result.checks)


def test_a_noise_that_adapts_is_no_jacobian() -> None:
    (check,) = transition(under_test(AdaptiveEkf)).checks
    assert (check.passed, check.result) == (None, "the covariance depends on the innovations")


class Fading(PlainEkf):
    """The covariance is multiplied in each prediction."""

    def predict(self, x: Any, P: Any, dt: float) -> Any:
        x, P = super().predict(x, P, dt)
        return x, 1.2 * P


def test_a_memory_that_fades_is_no_jacobian() -> None:
    assert all(check.passed for check in transition(under_test(Fading)).checks)


def test_a_wrong_jacobian_gives_the_gain_with_the_stated_noise() -> None:
    tracker = mutant_under_test("jacobian_wrong/plain_ekf/rate_term_missing")
    models = [one for trial in tracker.trials["radar"] if (one := implied(trial))]
    np.testing.assert_allclose([one.own_noise for one in models], 1.0, atol=0.02)


@pytest.fixture(scope="module")
def driven() -> Any:
    return drives_of("tangential_pass", "stationary")


@pytest.fixture
def made(tmp_path: Any, monkeypatch: Any) -> Callable[[Program], Make]:
    """Gives the tracker of a program."""

    return lambda program: tracker_of(program, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("name", "module", "sensor", "fault"),
    [("seen", "sound_schmidt", "lidar", "jacobian_wrong"), ("practice3", "imm_three", "radar", "gain_inconsistent")],
)
def test_a_gain_of_another_kind_without_harm_is_a_remark(
    name: str, module: str, sensor: str, fault: str, driven: Any, made: Any
) -> None:
    make = made(program_named(sound(name), module))
    result = gain(under_test(make, driven))
    assert result.findings == []
    assert [check.passed for check in result.checks] == [True, True]
    assert "not a Kalman gain" in next(check.result for check in result.checks if check.name == f"gain.{sensor}")
    # Without drives nothing shows that it does no harm.
    assert [finding.fault for finding in gain(under_test(make)).findings] == [fault]


def test_a_gain_that_is_wrong_after_other_sensors_alone_is_no_jacobian(driven: Any, made: Any) -> None:
    make = made(program_named(sound("practice3"), "correlated_tracks"))
    assert gain(under_test(make, driven)).findings == []


def test_a_range_rate_along_the_measured_ray_has_the_noise_of_the_ray(made: Any) -> None:
    assert gain(under_test(made(program_named(bases("practice4"), "dict_kf")))).findings == []


def test_declared_random_numbers_are_in_the_covariance(made: Any) -> None:
    (check,) = transition(under_test(made(program_named(sound("practice3"), "transform_ensemble")))).checks
    assert (check.passed, check.result) == (None, OTHER_ANSWERS)


@pytest.mark.parametrize(
    ("part", "name", "module", "fault"),
    [
        (noise_powers, "practice4", "noise_of_another_order", "q_wrong_power_of_dt"),
        (transition, "practice4", "product_of_entries", "predicted_covariance_wrong"),
        # The gate rejects all that the radar measures.
        (expectation, "practice4", "sign_of_the_speed", "doppler_sign"),
        (expectation, "aside", "range_rate_is_speed", "speed_for_range_rate"),
        (first_position, "aside", "start_without_own_velocity", "ego_motion_ignored"),
        # Wrong once a track has a course.
        (spreading, "aside", "turned_terms_with_wrong_sign", "jacobian_wrong"),
        (modes, "aside", "imm_determinant_without_logarithm", "imm_likelihood_wrong"),
        (wrapping, "aside", "imm_courses_averaged", "course_not_wrapped"),
    ],
)
def test_a_fault_of_a_program_is_named(part: Part, name: str, module: str, fault: str, made: Any) -> None:
    found = part(under_test(made(program_named(faults(name), module)))).findings
    assert {finding.fault for finding in found} == {fault}


@pytest.mark.parametrize(
    ("part", "base"),
    [
        (expectation, "ekf_polar"),
        (first_position, "ekf_polar"),
        (spreading, "autoware_style"),
        (modes, "imm_pair"),
        (wrapping, "imm_course"),
    ],
)
def test_a_base_has_none_of_them(part: Part, base: str, made: Any) -> None:
    assert part(under_test(made(program_named(bases("aside"), base)))).findings == []


def test_a_covariance_returned_in_another_order_is_named_by_the_nees_of_a_part(driven: Any, made: Any) -> None:
    make = made(program_named(faults("aside"), "root_multiplied_in_wrong_order"))
    assert {finding.fault for finding in stated_covariance(under_test(make, driven)).findings} == {
        "wrong_covariance_returned"
    }


def test_samples_that_nobody_declared_are_seen_in_the_covariance(made: Any) -> None:
    tracker = under_test(made(program_named(sound("aside"), "ensemble")))
    assert has_samples(tracker)
    assert one_gain(tracker).findings == []
    assert not has_samples(under_test(PlainEkf))


def test_a_noise_somewhat_larger_than_stated_is_a_remark(driven: Any, made: Any) -> None:
    make = made(program_named(bases("aside"), "arduino_style"))
    result = gain(under_test(make, driven))
    assert result.findings == []
    assert "no harm" in next(check.result for check in result.checks if check.name == "gain.radar")
    assert [finding.fault for finding in gain(under_test(make)).findings] == ["r_too_large"]


class DividedByX(PlainEkf):
    """The range rate is divided by the distance along x."""

    def range_rate(self, target: Any, scan: Any) -> Any:
        dx, dy = target[:2] - scan.sensor_pose[:2]
        return super().range_rate(target, scan) * np.hypot(dx, dy) / abs(dx)


def test_a_range_rate_that_is_wrong_in_no_known_way_is_told() -> None:
    (found,) = [one for one in expectation(under_test(DividedByX)).findings if one.sensor == "radar"]
    assert found.fault == "speed_for_range_rate"
    assert "the range rate alone is predicted wrongly" in found.evidence


class NoiseAlongX(PlainEkf):
    """Its process noise is that of an acceleration along x alone."""

    def predict(self, x: Any, P: Any, dt: float) -> Any:
        x, predicted = super().predict(x, P, dt)
        F = np.eye(4) + dt * np.eye(4, k=2)
        noise = predicted - F @ P @ F.T
        noise[1::2], noise[:, 1::2] = 0.0, 0.0
        return x, F @ P @ F.T + noise


def test_a_velocity_without_noise_along_an_axis_is_named() -> None:
    (found,) = growth_by_noise(under_test(NoiseAlongX)).findings
    assert found.fault == "process_noise_omitted"
    assert found.evidence.endswith("velocity along (0, 1) does not grow")


def test_positions_without_noise_say_nothing_of_sigma_points(made: Any) -> None:
    (check,) = no_time(under_test(made(program_named(faults("practice4"), "covariances_left_at_zero")))).checks
    assert check.passed is None


def test_a_gate_that_ends_a_track_in_a_turn_in_a_gap_is_fragile(made: Any) -> None:
    make = made(program_named(bases("practice4"), "tiny_ekf"))
    result = drives(under_test(make, drives_of("gap_in_a_turn", "own_model")))
    assert {check.name: check.passed for check in result.checks} == {"gap_in_a_turn": None, "own_model": True}
    assert {finding.fragile for finding in result.findings} == {"a turn in a gap"}


def test_harm_is_an_error_or_a_covariance_that_is_off(driven: Any) -> None:
    assert harmless(under_test(PlainEkf, driven)) is not None
    assert harmless(under_test(mutant("wrong_covariance_returned/plain_ekf/root").make, driven)) is None

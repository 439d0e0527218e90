"""A course that passes pi, a range of zero, and Jacobians that are written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.correct import CORRECT
from benchmarks.doctor.faults import MUTANTS
from benchmarks.doctor.filter_faults import UnguardedRange
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.doctor.step_faults import MeanWrappedFirst
from benchmarks.faults.corpus import Program, bases, faults, sound
from tests.support.doctor import Make, mutant_under_test, program_named, tracker_of, under_test

import trackbench as tb
from trackbench.base.types import Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.checks.jacobians import written_jacobians
from trackbench.subjects.doctor.checks.steps import jumping_angle
from trackbench.subjects.doctor.checks.validity import validity
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.course_jump import course_jump, followed
from trackbench.subjects.doctor.findings import PROVEN
from trackbench.subjects.doctor.inside.own_filter import own_filter
from trackbench.subjects.doctor.probes import COURSE_TURN
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.subject import SENSORS

COURSES = [mutant for mutant in MUTANTS if mutant.fault == "course_not_wrapped"]
SOUND = ["PlainUkf first_measurement", "PlainUkf two_measurements", "ekf ctrv usual, first_measurement"]
SOUND += ["ukf ctrv usual, first_measurement", "ckf ctrv usual, two_measurements", "imm", "ensemble"]


def _scans(probe: Any = COURSE_TURN, seconds: float = 5.0) -> list[Scan]:
    return under_test(PlainEkf).approach(probe, tuple(SENSORS), seconds)


def test_the_turning_target_is_on_a_circle() -> None:
    """Of radius v / w about a point to the left of its velocity; its course is pi at -0.5 s."""
    rate, speed = COURSE_TURN.turn_rate, np.hypot(*COURSE_TURN.target[2:])
    for time in (-5.0, -0.5, 0.0):
        px, py, vx, vy = COURSE_TURN.truth(time)
        assert np.hypot(vx, vy) == pytest.approx(speed)
        centre = np.array([px - vy / rate, py + vx / rate])
        x, y, ux, uy = COURSE_TURN.target
        np.testing.assert_allclose(centre, [x - uy / rate, y + ux / rate])
    assert abs(np.arctan2(*COURSE_TURN.truth(-0.5)[:1:-1])) == pytest.approx(np.pi, abs=1e-3)


@pytest.mark.parametrize("mutant", COURSES, ids=lambda mutant: mutant.name)
def test_a_turn_through_the_course_pi_shows_plain_differences(mutant: Any) -> None:
    scans = _scans()
    found = course_jump(mutant.make, scans, followed(mutant.make, scans))
    assert found is not None
    assert found.size > 100.0
    assert found.scan.time == pytest.approx(-0.5, abs=0.1)


@pytest.mark.parametrize("name", SOUND)
def test_no_course_jumps_in_a_sound_tracker(name: str) -> None:
    scans = _scans()
    assert course_jump(CORRECT[name], scans, followed(CORRECT[name], scans)) is None


@pytest.mark.slow
@pytest.mark.parametrize("mutant", COURSES, ids=lambda mutant: mutant.name)
def test_the_check_of_the_course_names_it(mutant: Any) -> None:
    found = wrapping(mutant_under_test(mutant.name)).findings
    assert [finding.fault for finding in found] == ["course_not_wrapped"]


class Definite(MeanWrappedFirst, PlainUkf):
    """Takes a course that is as good as unknown for an error."""

    def predict(self, x: Any, P: Any, dt: float) -> Any:
        x, P = super().predict(x, P, dt)
        if P[3, 3] > 10.0:
            raise ValueError("no course")
        return x, P


def _failure(make: Callable[[], Any], scans: list[Scan]) -> StepFailed:
    failure = followed(make, scans).failure
    assert failure is not None
    return failure


def test_a_step_that_fails_where_the_course_jumps_is_named() -> None:
    found = jumping_angle(Definite, _failure(Definite, _scans()))
    assert found is not None
    assert found[0] == "course_not_wrapped"


class RangeZero(UnguardedRange, PlainEkf):
    pass


def test_a_range_of_zero_is_said() -> None:
    (finding,) = [finding for finding in validity(under_test(RangeZero)).findings if finding.fault == "nonfinite"]
    assert finding.shown_by == "at_sensor"
    assert "where the range is 0" in finding.evidence


def test_a_tracker_that_fails_at_a_range_of_zero_alone_passes_the_check() -> None:
    (check,) = [one for one in validity(under_test(RangeZero)).checks if one.name == "finite"]
    assert check.passed
    assert "at_sensor" in check.result


@pytest.fixture
def made(tmp_path: Path, monkeypatch: Any) -> Callable[[Program], Make]:
    """Gives the tracker of a program."""
    return lambda program: tracker_of(program, tmp_path, monkeypatch)


def test_the_derivative_of_a_prediction_is_that_of_its_motion() -> None:
    tracker = under_test(PlainEkf)
    session = tracker.session_of_most(tracker.probes.general[0])
    assert session is not None
    own = own_filter(session)
    assert own is not None
    later = empty_scan(session.given[-1]._replace(time=own.time + 0.3))
    F = own.derivative(later, lambda after: after.mean)
    np.testing.assert_allclose(F, np.eye(4) + 0.3 * np.eye(4, k=2), atol=1e-8)
    # The one that was followed is as it was.
    assert own_filter(session) is not None
    assert session.given[-1].time == own.time


@pytest.mark.parametrize("make", [PlainEkf, PlainUkf])
def test_mean_and_covariance_are_found(make: Any) -> None:
    tracker = under_test(make)
    session = tracker.session_of_most(tracker.probes.general[0])
    assert session is not None
    own = own_filter(session)
    assert own is not None
    assert len(own.mean) == (4 if make is PlainEkf else 5)
    result = written_jacobians(tracker)
    assert [check.passed for check in result.checks] == [True]
    assert result.findings == []


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("aside2", "sign_of_one_derivative_by_the_turn_rate"),
        ("aside2", "sine_and_cosine_exchanged"),
        ("practice5", "speed_missing_in_the_jacobian"),
        ("seen", "jacobian_sign_of_turn_rate"),
    ],
)
def test_the_line_of_a_wrong_entry_is_named(name: str, module: str, made: Callable[[Program], Make]) -> None:
    program = program_named(faults(name), module)
    (finding,) = written_jacobians(under_test(made(program))).findings
    assert (finding.fault, finding.confidence) == ("jacobian_wrong", PROVEN)
    (line,) = re.findall(rf"{module}\.py:(\d+)", finding.evidence)
    assert int(line) in program.lines


def test_a_transposed_transition_is_named(made: Callable[[Program], Make]) -> None:
    program = program_named(faults("aside2"), "transposed_on_the_left")
    (finding,) = written_jacobians(under_test(made(program))).findings
    assert finding.fault == "predicted_covariance_wrong"
    assert "F^T P F" in finding.evidence


@pytest.mark.parametrize("name", ["aside", "practice4", "practice5", "aside2"])
def test_no_base_has_a_wrong_jacobian(name: str, made: Callable[[Program], Make]) -> None:
    for program in bases(name):
        if program.identities == "known":
            assert written_jacobians(under_test(made(program))).findings == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["practice3", "practice5", "aside4"])
def test_no_sound_program_has_a_wrong_jacobian(name: str, made: Callable[[Program], Make]) -> None:
    for program in sound(name):
        if program.identities == "known":
            assert written_jacobians(under_test(made(program))).findings == []


@pytest.mark.slow
def test_a_tracker_in_a_process_of_its_own_is_looked_into(tmp_path: Path, monkeypatch: Any) -> None:
    program = program_named(faults("seen"), "jacobian_sign_of_turn_rate")
    program.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    steps: list[float] = []
    found = tb.doctor(program.reference, progress=lambda done, _: steps.append(done))
    assert found.causes[0].fault == "jacobian_wrong"
    assert "jacobian_sign_of_turn_rate.py:" in found.causes[0].evidence
    assert len(steps) > 3

"""Jacobians that are written, held against differences of the filter itself; the line that is wrong is named."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.faults.corpus import Program, bases, faults, sound
from tests.support.doctor import Make, program_named, tracker_of, under_test, with_causes

import trackbench as tb
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.certainty import certainty
from trackbench.subjects.doctor.checks.written_jacobians import written_jacobians
from trackbench.subjects.doctor.findings import PROVEN, CheckResult, Finding, rank_findings
from trackbench.subjects.doctor.inside.own_filter import own_filter, put
from trackbench.subjects.doctor.report import Examination


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


def test_a_value_is_put_where_it_is_held() -> None:
    root = ({"x": [0.0, 1.0], "P": np.eye(2)}, (0.0, 1.0))
    assert put(root, (0, "x"), np.array([2.0, 3.0]))
    assert put(root, (0, "P"), 2.0 * np.eye(2))
    assert root[0]["x"] == [2.0, 3.0]
    np.testing.assert_array_equal(root[0]["P"], 2.0 * np.eye(2))
    # A tuple cannot be changed.
    assert not put(root, (1,), np.array([2.0, 3.0]))


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


def test_a_line_that_is_seen_to_be_wrong_explains_what_else_is_found() -> None:
    found = rank_findings([Finding("course_not_wrapped", 0.97, ""), Finding("jacobian_wrong", PROVEN, "")])
    assert with_causes(found) == [
        ("jacobian_wrong", None),
        ("course_not_wrapped", "jacobian_wrong"),
    ]
    check = CheckResult("course_wrapping", "", False, "", faults=("course_not_wrapped",))
    assert certainty(Examination("", found, [check])).word == "shown"


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

"""A course that passes pi, and what a failed step or a range of zero says of other findings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmarks.doctor.correct import CORRECT
from benchmarks.doctor.faults import MUTANTS
from benchmarks.doctor.filter_faults import UnguardedRange
from benchmarks.doctor.plain_ekf import PlainEkf
from benchmarks.doctor.plain_ukf import PlainUkf
from benchmarks.doctor.step_faults import MeanWrappedFirst
from tests.support.doctor import mutant_under_test, under_test, with_causes

from trackbench.base.types import Scan
from trackbench.subjects.doctor.checks.steps import jumping_angle
from trackbench.subjects.doctor.checks.validity import validity
from trackbench.subjects.doctor.checks.wrapping import wrapping
from trackbench.subjects.doctor.course_jump import course_jump, followed
from trackbench.subjects.doctor.findings import Finding, rank_findings
from trackbench.subjects.doctor.probes import COURSE_TURN, GENERAL, Probes
from trackbench.subjects.doctor.session import StepFailed
from trackbench.subjects.doctor.site import Carrier, SensorSite
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


def test_its_course_is_that_of_the_fixed_frame_at_every_site() -> None:
    site = SensorSite(Carrier(5.0, -3.0, 2.0), None, (1.0, 0.0, 0.5))
    placed = Probes().placed([site]).course_turn
    assert placed.target[2:] == COURSE_TURN.target[2:]
    assert placed.turn_rate == COURSE_TURN.turn_rate


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
@pytest.mark.parametrize("name", CORRECT)
def test_no_course_jumps_in_any_sound_tracker(name: str) -> None:
    scans = _scans()
    assert course_jump(CORRECT[name], scans, followed(CORRECT[name], scans)) is None


@pytest.mark.slow
@pytest.mark.parametrize("mutant", COURSES, ids=lambda mutant: mutant.name)
def test_the_check_of_the_course_names_it(mutant: Any) -> None:
    found = wrapping(mutant_under_test(mutant.name)).findings
    assert [one.fault for one in found] == ["course_not_wrapped"]


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


class RaisesAt(PlainUkf):
    """Raises at some courses of its own."""

    courses: tuple[tuple[float, float], ...] = ((3.0, 3.2),)

    def update(self, x: Any, P: Any, scan: Any) -> Any:
        if scan.time > -1.0 and any(low < x[3] < high for low, high in self.courses):
            raise ValueError("Matrix is not positive definite")
        return super().update(x, P, scan)


class RaisesAtTwo(RaisesAt):
    """One is that of the scene turned by -1.5 rad."""

    courses = ((3.0, 3.2), (1.5, 1.7))


def test_one_turned_scene_that_passes_is_not_enough() -> None:
    """At the same time one turned scene breaks it, and the other does not."""
    scans = _scans()
    failure = _failure(RaisesAtTwo, scans)
    broken = [followed(RaisesAtTwo, [*failure.given, failure.scan], angle).failure for angle in (-0.9, -1.5)]
    assert [one is None for one in broken] == [True, False]
    assert jumping_angle(RaisesAtTwo, failure) is None
    assert jumping_angle(RaisesAt, _failure(RaisesAt, scans)) is not None


class RangeZero(UnguardedRange, PlainEkf):
    pass


def test_a_range_of_zero_is_said() -> None:
    (finding,) = [one for one in validity(under_test(RangeZero)).findings if one.fault == "nonfinite"]
    assert finding.shown_by == "at_sensor"
    assert "where the range is 0" in finding.evidence


def test_what_is_not_finite_elsewhere_is_told_first() -> None:
    tracker, bad = under_test(PlainEkf), np.full((4, 1), np.nan)
    scan = GENERAL[0].scan("radar", SENSORS["radar"], 0.0)
    for where, expected in (("at_sensor", "at_sensor"), ("crossing", "crossing"), ("on_the_sensor", "crossing")):
        tracker.output_checks.add_batch(bad, np.eye(4)[..., None], [scan], where, lambda _: [scan])
        assert tracker.output_checks.not_finite is not None
        assert tracker.output_checks.not_finite.where == expected


@pytest.mark.parametrize(
    ("where", "fragile"), [("at_sensor", "range 0"), ("on_the_sensor", "range 0"), ("crossing", None)]
)
def test_a_failure_at_a_range_of_zero_alone_is_no_fault(where: str, fragile: str | None) -> None:
    assert Finding("nonfinite", 0.98, "", shown_by=where).fragile == fragile


def test_a_tracker_that_fails_at_a_range_of_zero_alone_passes_the_check() -> None:
    (check,) = [one for one in validity(under_test(RangeZero)).checks if one.name == "finite"]
    assert check.passed
    assert "at_sensor" in check.result


@pytest.mark.parametrize("cause", ["q_too_large", "course_not_wrapped"])
@pytest.mark.parametrize("effect", ["covariance_not_psd", "predicted_covariance_not_psd"])
def test_points_too_far_apart_have_no_covariance(cause: str, effect: str) -> None:
    found = rank_findings([Finding(effect, 0.97, ""), Finding(cause, 0.9, "")])
    assert with_causes(found) == [(cause, None), (effect, cause)]

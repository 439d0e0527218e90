"""What the doctor makes of a step that fails, of a covariance that is none, and of two faults at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from benchmarks.doctor import filter_faults as filtering
from benchmarks.doctor import sensor_faults as sensing
from benchmarks.doctor.cholesky_ukf import CholeskyUkf
from benchmarks.doctor.pairs import PAIRS
from benchmarks.doctor.plain_ekf import PlainEkf
from tests.support.doctor import scans_of, under_test, with_causes

from trackbench.base.types import Scan
from trackbench.subjects.doctor.checks.steps import (
    CannotRun,
    failure_findings,
    jumping_angle,
    require_runnable,
)
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import Finding, rank_findings
from trackbench.subjects.doctor.output_checks import asymmetric, indefinite, mirrored_entries
from trackbench.subjects.doctor.probes import AXES, GENERAL
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.subject import SENSORS


def failure_of(make: Callable[[], Any], scans: list[Scan]) -> StepFailed:
    session = TrackerSession(make)
    try:
        for scan in scans:
            session.step(scan)
    except StepFailed as failure:
        return failure
    pytest.fail("no step failed")


class CrossNotWrapped(sensing.BareCross, CholeskyUkf):
    """An unscented filter whose mean of azimuths is not circular, and whose gain does not fit its S there."""


class Gated(sensing.BareResidual, PlainEkf):
    """Takes an innovation of a turn for a broken sensor."""

    def innovation(self, scan: Any, predicted: Any) -> Any:
        y = super().innovation(scan, predicted)
        if abs(y[1]) > 5.0:
            raise ValueError("the sensor is broken")
        return y


class AheadOnly(PlainEkf):
    """Raises behind the sensor, for another reason than an azimuth that jumps."""

    def update(self, x: Any, P: Any, scan: Any) -> Any:
        if x[0] < -23.1:
            raise ValueError("the target is behind")
        return super().update(x, P, scan)


CROSSING = AXES[0]._replace(target=(-23.0, 0.0, -0.2, -7.0))


def test_a_mean_of_azimuths_across_pi_is_named_by_the_failed_factor() -> None:
    failure = failure_of(CrossNotWrapped, scans_of(CROSSING, until=0.5))
    assert failure.fault.cause == "LinAlgError: Matrix is not positive definite"
    found = jumping_angle(CrossNotWrapped, failure)
    assert found is not None
    assert (found[0], found[2]) == ("angle_mean_not_circular", "radar")


def test_an_innovation_across_pi_is_named_by_the_error() -> None:
    failure = failure_of(Gated, scans_of(CROSSING, until=0.5))
    found = jumping_angle(Gated, failure)
    assert found is not None
    assert (found[0], found[2]) == ("azimuth_not_wrapped", "radar")


def test_another_reason_behind_the_sensor_is_no_angle() -> None:
    assert jumping_angle(AheadOnly, failure_of(AheadOnly, scans_of(CROSSING, until=1.0))) is None


class MissedRaises(filtering.MissedRaises, PlainEkf):
    pass


class RadarRaises(PlainEkf):
    def update(self, x: Any, P: Any, scan: Any) -> Any:
        if scan.kind == "radar":
            raise KeyError("rho")
        return super().update(x, P, scan)


@pytest.mark.parametrize(
    ("make", "sensor", "words"),
    [
        (MissedRaises, None, "ValueError: nothing to read (benchmarks/doctor/filter_faults.py:"),
        (RadarRaises, "radar", "a missed measurement at that time does not break it"),
    ],
)
def test_an_exception_is_a_finding(make: type, sensor: str | None, words: str) -> None:
    tracker = under_test(make)
    require_runnable(tracker)
    for probe in GENERAL[:2]:
        for name in SENSORS:
            tracker.trial(probe, name, (name,))
    (finding,) = failure_findings(tracker)
    assert (finding.fault, finding.sensor) == ("exception_raised", sensor)
    assert words in finding.evidence
    assert "the smallest eigenvalue of the covariance is" in finding.evidence


def test_nothing_can_be_asked_of_one_that_raises_at_once() -> None:
    class Broken:
        def step(self, state: Any, scan: Scan) -> Any:
            raise KeyError("rho")

    with pytest.raises(CannotRun, match=r"KeyError: 'rho' \(.*at -3 s of ahead_left, at a measurement of lidar: lidar"):
        require_runnable(under_test(Broken))


class OneSided(filtering.OneSidedNoise, PlainEkf):
    pass


class Unsymmetric(filtering.UnsymmetricUpdate, PlainEkf):
    pass


class TooCorrelated(filtering.NoiseTooCorrelated, PlainEkf):
    pass


class TooMuch(filtering.SubtractsTooMuch, PlainEkf):
    pass


def test_the_step_that_makes_a_covariance_asymmetric() -> None:
    scans = scans_of(GENERAL[0])
    found = asymmetric(OneSided, scans)
    assert found is not None
    assert found.step == "prediction"
    # Q of px and vx is sigma^2 dt^3 / 2 on one side only; the first covariance has none.
    time = scans[2].time - scans[0].time
    assert found.after[0, 2] - found.after[2, 0] == pytest.approx(9.0 * time**3 / 2, rel=1e-6)
    assert "row px, column vx" in mirrored_entries(found)
    found = asymmetric(Unsymmetric, scans)
    assert found is not None
    assert found.step == "update"
    assert asymmetric(PlainEkf, scans) is None


def test_the_step_that_makes_a_covariance_indefinite() -> None:
    scans = scans_of(GENERAL[0])
    found = indefinite(TooMuch, scans)
    assert found is not None
    assert found.step == "update"
    found = indefinite(partial(TooCorrelated, acceleration_sigma=300.0), scans)
    assert found is not None
    assert found.step == "prediction"
    assert indefinite(PlainEkf, scans) is None


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("q_too_small", 0.9, "")),
        (Finding("azimuth_not_wrapped", 0.97, "", sensor="radar"), Finding("wrong_dt", 0.97, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("r_too_small", 0.9, "", sensor="lidar")),
        (Finding("axis_mirrored", 0.98, "", sensor="lidar"), Finding("azimuth_not_wrapped", 0.97, "", sensor="radar")),
        (Finding("jacobian_wrong", 0.95, "", sensor="radar"), Finding("azimuth_not_wrapped", 0.97, "", sensor="radar")),
        (Finding("ego_motion_ignored", 0.98, ""), Finding("doppler_sign", 0.99, "", sensor="radar")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("exception_raised", 0.97, "", sensor="radar")),
        (Finding("covariance_asymmetric", 0.95, ""), Finding("degrees_for_radians", 0.99, "", sensor="radar")),
        (Finding("integer_state_matrix", 0.98, ""), Finding("axis_swapped", 0.98, "", sensor="lidar")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("q_constant_per_step", 0.96, "")),
        (
            Finding("angle_mean_not_circular", 0.95, "", sensor="radar"),
            Finding("covariance_not_reduced", 0.97, "", sensor="lidar"),
        ),
    ],
)
def test_neither_of_two_independent_findings_is_a_consequence(first: Finding, second: Finding) -> None:
    for found in (rank_findings([first, second]), rank_findings([second, first])):
        assert [finding.consequence_of for finding in found] == [None, None]


@pytest.mark.parametrize(
    ("cause", "effect"),
    [
        (Finding("axis_mirrored", 0.98, "", sensor="lidar"), Finding("jacobian_wrong", 0.95, "", sensor="lidar")),
        (Finding("axis_mirrored", 0.98, "", sensor="lidar"), Finding("overconfident_start", 0.9, "")),
        (Finding("wrong_dt", 0.97, ""), Finding("q_too_large", 0.97, "")),
        (Finding("arctan_quadrant", 0.99, "", sensor="radar"), Finding("nonfinite", 0.98, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("invalid_estimate", 0.85, "")),
        (Finding("predicted_covariance_not_psd", 0.95, ""), Finding("q_too_small", 0.97, "")),
        (Finding("angle_mean_not_circular", 0.95, "", sensor="radar"), Finding("azimuth_not_wrapped", 0.97, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("velocity_not_kept", 0.95, "")),
        (Finding("velocity_unit", 0.97, ""), Finding("doppler_sign", 0.99, "", sensor="radar")),
        (Finding("jacobian_wrong", 0.83, "", sensor="radar"), Finding("azimuth_not_wrapped", 0.85, "", sensor="radar")),
        (Finding("sigma_spread_wrong", 0.95, ""), Finding("invalid_estimate", 0.85, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("too_far_off", 0.85, "")),
    ],
)
def test_a_consequence_is_one_of_the_same_sensor(cause: Finding, effect: Finding) -> None:
    found = rank_findings([effect, cause])
    assert with_causes(found) == [(cause.fault, None), (effect.fault, cause.fault)]


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.name)
def test_both_faults_of_a_pair_are_main_findings(pair: Any) -> None:
    found = Doctor(SENSORS, seed=1).examine(pair.name, pair.make)
    main = {finding.fault for finding in found.findings if finding.consequence_of is None}
    assert {part.fault for part in pair.parts} <= main


@pytest.mark.slow
def test_the_examination_goes_on_after_exceptions() -> None:
    found = Doctor(SENSORS, seed=1).examine("radar raises", RadarRaises)
    assert [finding.fault for finding in found.findings] == ["exception_raised"]
    passed = {check.name: check.passed for check in found.checks}
    assert passed["expectation.lidar"]
    assert passed["gain.lidar"]
    assert passed["prediction"]
    assert passed["expectation.radar"] is not True

"""What the doctor makes of a step that fails, of a covariance that is none, and of two faults at once."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.doctor import scans_of, under_test, with_causes

from trackbench.base.types import Scan
from trackbench.subjects.doctor.checks.steps import (
    CannotRun,
    failure_findings,
    require_runnable,
)
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import PROVEN, Finding, rank_findings
from trackbench.subjects.doctor.output_checks import first_asymmetric_step, first_indefinite_step, mirrored_entries
from trackbench.subjects.doctor.probes import GENERAL
from trackbench.subjects.doctor.subject import SENSORS


class MissedRaises(PlainEkf):
    """Reads a measurement without a look whether it is there."""

    def usable(self, scan: Any) -> bool:
        if not scan.valid:
            raise ValueError("nothing to read")
        return True


class RadarRaises(PlainEkf):
    def update(self, x: Any, P: Any, scan: Any) -> Any:
        if scan.kind == "radar":
            raise KeyError("rho")
        return super().update(x, P, scan)


@pytest.mark.parametrize(
    ("make", "sensor", "words"),
    [
        (MissedRaises, None, "ValueError: nothing to read (tests/subjects/doctor/test_doctor_failures.py:"),
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


def test_nothing_can_be_asked_of_one_that_raises_at_once() -> None:
    class Broken:
        def step(self, state: Any, scan: Scan) -> Any:
            raise KeyError("rho")

    with pytest.raises(CannotRun, match=r"KeyError: 'rho' \(.*at -3 s of ahead_left, at a measurement of lidar: lidar"):
        require_runnable(under_test(Broken))


class OneSided(PlainEkf):
    """Process noise without the entries below its diagonal, and a correction that does not symmetrise."""

    def process_noise(self, x: Any, dt: float) -> Any:
        return np.triu(super().process_noise(x, dt))

    def corrected_covariance(self, P: Any, K: Any, S: Any) -> Any:
        return P - K @ S @ K.T


class Unsymmetric(PlainEkf):
    """The upper triangle of each corrected covariance off by a thousandth."""

    def corrected_covariance(self, P: Any, K: Any, S: Any) -> Any:
        P = super().corrected_covariance(P, K, S)
        return P * (1 + np.triu(np.full(P.shape, 1e-3), 1))


class TooCorrelated(PlainEkf):
    """Process noise whose position and velocity have twice the covariance that their variances allow."""

    def process_noise(self, x: Any, dt: float) -> Any:
        Q = super().process_noise(x, dt)
        Q[0, 2] = Q[2, 0] = 2 * Q[0, 2]
        return Q


class TooMuch(PlainEkf):
    """Subtracts half as much again from the covariance as the update should."""

    def corrected_covariance(self, P: Any, K: Any, S: Any) -> Any:
        return super().corrected_covariance(P, np.sqrt(1.5) * K, S)


def test_the_step_that_makes_a_covariance_asymmetric() -> None:
    scans = scans_of(GENERAL[0])
    found = first_asymmetric_step(OneSided, scans)
    assert found is not None
    assert found.step == "prediction"
    # Q of px and vx is sigma^2 dt^3 / 2 on one side only; the first covariance has none.
    time = scans[2].time - scans[0].time
    assert found.after[0, 2] - found.after[2, 0] == pytest.approx(9.0 * time**3 / 2, rel=1e-6)
    assert "row px, column vx" in mirrored_entries(found)
    found = first_asymmetric_step(Unsymmetric, scans)
    assert found is not None
    assert found.step == "update"
    assert first_asymmetric_step(PlainEkf, scans) is None


def test_the_step_that_makes_a_covariance_indefinite() -> None:
    scans = scans_of(GENERAL[0])
    found = first_indefinite_step(TooMuch, scans)
    assert found is not None
    assert found.step == "update"
    found = first_indefinite_step(partial(TooCorrelated, acceleration_sigma=300.0), scans)
    assert found is not None
    assert found.step == "prediction"
    assert first_indefinite_step(PlainEkf, scans) is None


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("q_too_small", 0.9, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("r_too_small", 0.9, "", sensor="lidar")),
        (Finding("jacobian_wrong", 0.95, "", sensor="radar"), Finding("azimuth_not_wrapped", 0.97, "", sensor="radar")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("exception_raised", 0.97, "", sensor="radar")),
        (Finding("r_too_small", 0.7, "", sensor="radar"), Finding("overconfident_start", 0.7, "")),
    ],
)
def test_neither_of_two_independent_findings_is_a_consequence(first: Finding, second: Finding) -> None:
    for found in (rank_findings([first, second]), rank_findings([second, first])):
        assert [finding.consequence_of for finding in found] == [None, None]


@pytest.mark.parametrize(
    ("cause", "effect"),
    [
        (Finding("axis_mirrored", 0.98, "", sensor="lidar"), Finding("jacobian_wrong", 0.95, "", sensor="lidar")),
        (Finding("wrong_dt", 0.97, ""), Finding("q_too_large", 0.97, "")),
        (Finding("predicted_covariance_wrong", 0.96, ""), Finding("update_not_kept", 0.95, "")),
        (Finding("predicted_covariance_not_psd", 0.95, ""), Finding("q_too_small", 0.97, "")),
        (Finding("angle_mean_not_circular", 0.95, "", sensor="radar"), Finding("azimuth_not_wrapped", 0.85, "")),
        (Finding("doppler_sign", 0.99, "", sensor="radar"), Finding("too_far_off", 0.85, "")),
        (Finding("jacobian_wrong", PROVEN, ""), Finding("q_too_large", 0.97, "")),
    ],
)
def test_a_consequence_is_one_of_the_same_sensor_and_a_higher_rank(cause: Finding, effect: Finding) -> None:
    for found in (rank_findings([effect, cause]), rank_findings([cause, effect])):
        assert with_causes(found) == [(cause.fault, None), (effect.fault, cause.fault)]


@pytest.mark.slow
def test_the_examination_goes_on_after_exceptions() -> None:
    found = Doctor(SENSORS, seed=1).examine("radar raises", RadarRaises)
    assert [finding.fault for finding in found.findings] == ["exception_raised"]
    passed = {check.name: check.passed for check in found.checks}
    assert passed["expectation.lidar"]
    assert passed["gain.lidar"]
    assert passed["prediction"]
    assert passed["expectation.radar"] is not True

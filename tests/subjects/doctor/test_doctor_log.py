"""A tracker examined on the recorded scans of a log, without truth."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import DOCS

from trackbench.base.errors import InputError
from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.api import doctor
from trackbench.subjects.doctor.findings import CHECKS, LOG_CHECKS, questions
from trackbench.subjects.doctor.log_checks.consistency import block_interval
from trackbench.subjects.doctor.log_doctor import LogDoctor
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.subject import SENSORS
from trackbench.trackers.builtin import ekf


@cache
def recorded(seed: int = 1, offset: float = 0.0, bias: float = 0.0) -> tuple[Scan, ...]:
    """A target that goes around the sensors with white acceleration for 30 s, by lidar and radar at 10 Hz each.

    Args:
        seed: of the noise.
        offset: of the radar's measurements after their time, s.
        bias: of its ranges, m.
    """
    random, state, scans = np.random.default_rng(seed), np.array([15.0, -5.0, 0.0, 6.0]), []
    for k in range(600):
        step, away = 0.05, float(np.hypot(*state[:2]))
        turn = 0.4 * np.array([-state[3], state[2]]) - 0.1 * (away - 15.0) * state[:2] / away
        acceleration = turn + 2.0 * random.normal(size=2)
        state = state + np.array([*(state[2:] * step + acceleration * step**2 / 2), *(acceleration * step)])
        name = ("lidar", "radar")[k % 2]
        radar, noise = name == "radar", SENSORS[name].noise_covariance()
        seen = state + np.array([*(offset * radar * state[2:]), 0.0, 0.0])
        measurement = SENSORS[name].measure(seen, np.zeros(3), np.zeros(2))
        measurement += np.sqrt(np.diag(noise)) * random.normal(size=len(noise))
        if radar:
            measurement[0] += bias
            measurement[1] = (measurement[1] + np.pi) % (2 * np.pi) - np.pi
        at_rest = (np.zeros(3), np.zeros(2))
        scans.append(Scan(k * step, name, name, measurement, np.array(True), noise, *at_rest, k * step))
    return tuple(scans)


def changed(change: Callable[[Scan], Scan] = lambda scan: scan, **options: Any) -> Callable[[], Any]:
    """The built-in filter, which is given changed scans."""

    class Changed:
        def __init__(self) -> None:
            self.tracker = ekf(motion="cv", late="drop", **{"acceleration_sigma_mps2": 3.0, **options})

        def step(self, state: Any, scan: Scan) -> Any:
            return self.tracker.step(state, change(scan))

    return Changed


def examined(make: Callable[[], Any], scans: Sequence[Scan] | None = None, **options: Any) -> Examination:
    return LogDoctor([recorded() if scans is None else scans], **options).examine("mine", make)


def failed(found: Examination) -> set[str]:
    return {check.name.partition(".")[0] for check in found.checks if check.passed is False}


def test_a_sound_filter_is_healthy_and_what_needs_a_truth_is_not_made() -> None:
    found = examined(changed())
    assert found.healthy
    assert {check.name.partition(".")[0] for check in found.checks if check.passed} == {*questions(LOG_CHECKS)}
    assert {check.name for check in found.checks if check.passed is None} >= {*questions(CHECKS)}


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_wrong_noise_shows_in_the_change_of_the_covariance(factor: float) -> None:
    found = examined(changed(lambda scan: scan._replace(noise_covariance=factor * scan.noise_covariance)))
    fault = "r_too_small" if factor < 1.0 else "r_too_large"
    assert [(finding.fault, finding.sensor) for finding in found.causes] == [(fault, "lidar"), (fault, "radar")]
    assert found.causes[0].factor == pytest.approx(factor, rel=0.01)


@pytest.mark.parametrize(
    ("sigma", "fault", "word"), [(0.1, "q_too_small", "likely"), (0.55, "covariance_unbelievable", "unclear")]
)
def test_an_estimate_that_lags(sigma: float, fault: str, word: str) -> None:
    """Its process noise is named only where that fits no road vehicle."""
    found = examined(changed(acceleration_sigma_mps2=sigma))
    assert [finding.fault for finding in found.causes] == [fault]
    assert failed(found) >= {"log_nis"}
    assert found.certainty().word == word


@pytest.mark.parametrize("offset", [0.1, -0.1])
def test_a_time_offset_of_the_recorded_scans(offset: float) -> None:
    found = examined(changed(), recorded(offset=offset))
    assert [finding.fault for finding in found.causes] == ["time_offset"]
    said = re.match(
        r"measurements of (\w+) fit the predictions best ([\d.]+) ms (\w+) the time of", found.causes[0].evidence
    )
    assert said is not None
    # Two sensors alone do not tell whose time is off.
    later = (said[1] == "radar") == (offset > 0.0)
    assert said[3] == ("after" if later else "before")
    assert float(said[2]) == pytest.approx(100.0, rel=0.35)


def test_a_bias() -> None:
    found = examined(changed(), recorded(bias=1.5))
    assert [(finding.fault, finding.sensor) for finding in found.causes] == [("sensor_bias", "radar")]


def test_the_student_s_azimuth_is_found_in_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS / "examples")
    from sensor_fusion_student import Tracker

    found = examined(Tracker)
    assert [(finding.fault, finding.sensor) for finding in found.causes] == [("azimuth_not_wrapped", "radar")]


#: For statements that need no more.
HALF = recorded()[:300]


class Lost:
    """Predicts with half of the time step."""

    def __init__(self, share: float) -> None:
        self.tracker, self.share, self.clock, self.time = changed()(), share, 0.0, None

    def step(self, state: Any, scan: Scan) -> Any:
        own = 0.0 if state is None else state[1] + self.share * (scan.time - state[2])
        inner, estimate = self.tracker.step(None if state is None else state[0], scan._replace(time=own))
        return (inner, own, scan.time), estimate


@pytest.mark.parametrize(("share", "fault"), [(0.5, "wrong_dt"), (0.0, "missed_scan_not_predicted")])
def test_a_wrong_time_step(share: float, fault: str) -> None:
    found = examined(lambda: Lost(share))
    assert fault in [finding.fault for finding in found.causes]
    assert "log_prediction" in failed(found)


class Silent:
    """Gives nothing at a missed scan."""

    def __init__(self) -> None:
        self.tracker = changed()()

    def step(self, state: Any, scan: Scan) -> Any:
        state, estimate = self.tracker.step(state, scan)
        return state, estimate if scan.valid else None


def test_a_tracker_without_predictions_is_not_judged_by_innovations() -> None:
    found = examined(Silent, HALF)
    assert found.healthy
    reasons = {check.name: check.result for check in found.checks if check.passed is None}
    assert "at a missed scan the tracker returns None" in reasons["log_nis.radar"]
    told = examined(Silent, HALF, no_misses=True)
    assert "--no-misses" in {check.name: check.result for check in told.checks}["log_nis.radar"]


class Fails(Silent):
    def step(self, state: Any, scan: Scan) -> Any:
        if scan.time > 20.0:
            raise KeyError("rho")
        return self.tracker.step(state, scan)


class NotFinite(Silent):
    def step(self, state: Any, scan: Scan) -> Any:
        state, estimate = self.tracker.step(state, scan)
        return state, Estimate(np.full(4, np.nan), np.eye(4), None) if scan.time > 20.0 else estimate


@pytest.mark.parametrize(("make", "fault"), [(Fails, "exception_raised"), (NotFinite, "nonfinite")])
def test_a_step_that_fails(make: Callable[[], Any], fault: str) -> None:
    found = examined(make)
    assert [finding.fault for finding in found.causes] == [fault]
    assert "log_steps" in failed(found)


def test_repeated_times_are_told() -> None:
    twice = sorted([*HALF, HALF[199]], key=lambda scan: scan.time)
    assert failed(examined(changed(), twice)) == {"log_stamps"}


def test_missed_scans_are_given_unless_there_are_none() -> None:
    scans = [empty_scan(scan) if k % 7 == 3 else scan for k, scan in enumerate(HALF)]
    assert examined(changed(), scans).healthy
    assert examined(changed(), scans, no_misses=True).healthy


def test_a_check_may_be_skipped_and_an_unknown_one_is_refused() -> None:
    found = examined(changed(), HALF, skip=["log_mean.radar"])
    assert [check.name for check in found.checks if check.skipped] == ["log_mean.radar"]
    with pytest.raises(InputError, match="did you mean 'log_mean"):
        LogDoctor([recorded()], skip=["log_meen.radar"])


def test_the_interval_of_correlated_values_is_that_of_blocks() -> None:
    """Twenty blocks of one value each, repeated: as many independent values."""
    means = np.random.default_rng(2).normal(size=20)
    mean, low, high = block_interval(np.repeat(means, 50), 0.025)
    assert mean == pytest.approx(means.mean())
    assert high - low == pytest.approx(2 * 2.093 * means.std(ddof=1) / np.sqrt(20), rel=1e-3)


def test_from_python_and_as_a_command(cli: Callable[..., Any], tiny: Path) -> None:
    options = {"motion": "cv", "acceleration_sigma_mps2": 3}
    found = doctor("ekf", options=options, log=tiny)
    assert {check.name for check in found.checks if check.passed is not None} >= {"log_steps", "log_prediction"}
    arguments = [word for key, value in options.items() for word in ("--option", f"{key}={value}")]
    done = cli("doctor", "ekf", *arguments, "--log", tiny.name, "--json")
    assert (done.status, done.err) == (0, "")
    assert json.loads(done.out) == found.json()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--scenario", "tiny.yaml"], "--log: a log has its own sensors and observer"),
        (["--static-sensors"], "--log: a log has its own sensors and observer"),
        (["--identities", "hidden"], "--log: only for a tracker of one object; this one follows several"),
    ],
)
def test_what_does_not_go_with_a_log(cli: Callable[..., Any], tiny: Path, arguments: list[str], said: str) -> None:
    done = cli("doctor", "raw", "--in-process", "--log", tiny.name, *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.err.splitlines()[-1] == said


def test_a_log_whose_detections_are_not_labelled_is_refused() -> None:
    with pytest.raises(InputError, match="do not say of which object"):
        doctor("ekf", options={"motion": "cv", "acceleration_sigma_mps2": 3}, log="traffic/cut_in")

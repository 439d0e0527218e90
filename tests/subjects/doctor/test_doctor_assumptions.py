"""What the user states of the tracker and its sensors, and the checks that are not made for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.faults.bases.plain_ekf import Tracker as PlainEkf
from tests.support.places import ROOT

from trackbench.base.types import Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import Mount, Radar
from trackbench.subjects.doctor.assumptions import Assumptions
from trackbench.subjects.doctor.checks.expectation import expectation
from trackbench.subjects.doctor.drives import Setting, simulate_drives
from trackbench.subjects.doctor.examine import Doctor
from trackbench.subjects.doctor.findings import (
    CheckResult,
    Finding,
    PartResult,
    check_named,
    questions,
)
from trackbench.subjects.doctor.probes import GENERAL, PASSING, Carrier, Probe, Probes, simplified, site_of
from trackbench.subjects.doctor.report import Examination, examination_verdict
from trackbench.subjects.doctor.session import MissGiven, TrackerFactory, TrackerSession
from trackbench.subjects.doctor.subject import SENSORS, find_tracker
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest

REPOSITORY = ROOT


class AzimuthOverRange(PlainEkf):
    """The derivatives of the azimuth have one power of the range too few."""

    def sensor_jacobian(self, x, scan):
        H = super().sensor_jacobian(x, scan)
        if scan.kind == "radar":
            H[1] *= np.hypot(*(x[:2] - scan.sensor_pose[:2]))
        return H


STANDING, MOVING = Carrier(-34.0, 34.0, -0.8), Carrier(180.0, -4.0, 0.3, 20.0, 6.0, 0.2)
RADAR = {
    "radar": Radar(rate_hz=10, mount=Mount(x_m=2.5), range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1)
}
NAMES = {"ego_motion", "moving_observer"}


def changed(make: Callable[[], Any], change: Callable[[Scan], Scan]) -> Callable[[], Any]:
    """The tracker, given other scans."""

    class Changed:
        def __init__(self) -> None:
            self.inner = make()

        def step(self, state: Any, scan: Scan) -> Any:
            return self.inner.step(state, change(scan))

    return Changed


def ignoring(make: Callable[[], Any]) -> Callable[[], Any]:
    """The tracker, as if its sensors were at the origin, at rest."""
    still = {"sensor_pose": np.zeros(3), "sensor_velocity": np.zeros(2)}
    return changed(make, lambda scan: scan._replace(**still))


def raising(scan: Scan) -> Scan:
    if not scan.valid:
        raise ValueError("there is no detection")
    return scan


@cache
def examined(which: str) -> Examination:
    """Examinations that several tests look at."""
    make, options = {
        "moving": (ignoring(PlainEkf), {}),
        "static": (ignoring(PlainEkf), {"static_sensors": True}),
        "standing": (ignoring(PlainEkf), {"observer": Carrier()}),
        "second": (ignoring(AzimuthOverRange), {"static_sensors": True}),
        "misses": (changed(PlainEkf, raising), {}),
        "no misses": (changed(PlainEkf, raising), {"no_misses": True}),
    }[which]
    return Doctor(SENSORS, **options).examine(which, make)


def not_made(examination: Examination) -> dict[str, str]:
    return {check.name: check.result for check in examination.checks if check.passed is None}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("which", "why"), [("static", "--static-sensors"), ("standing", "the scenario's stands still")]
)
def test_a_tracker_that_ignores_ego_motion_is_healthy_with_sensors_that_stand_still(which: str, why: str) -> None:
    found = examined(which)
    assert found.findings == []
    assert found.healthy
    assert {name: why in reason for name, reason in not_made(found).items()} == dict.fromkeys(NAMES, True)
    made = len(found.checks) - len(NAMES)
    assert (
        examination_verdict(found) == f"{which}: healthy in {made} of {len(found.checks)} checks; {len(NAMES)} not made"
    )


@pytest.mark.slow
def test_with_a_moving_observer_its_ego_motion_is_ignored() -> None:
    found = examined("moving")
    assert found.findings[0].fault == "ego_motion_ignored"
    assert {check.name: check.passed for check in found.checks}["ego_motion"] is False


@pytest.mark.slow
def test_the_fault_behind_it_is_found_first() -> None:
    first = examined("second").findings[0]
    assert (first.fault, first.sensor) == ("jacobian_wrong", "radar")


@pytest.mark.slow
def test_a_tracker_that_needs_a_detection_in_every_scan() -> None:
    assert [finding.fault for finding in examined("misses").findings] == ["exception_raised"]
    found = examined("no misses")
    assert found.findings == []
    assert found.healthy
    needing = {name for name, check in questions().items() if check.misses and not check.late}
    assert {name.partition(".")[0] for name in not_made(found)} == needing
    made = {check.name for check in found.checks if check.passed}
    assert made >= {"expectation.lidar", "azimuth_wrapping", "long_gap", "uneven_steps"}


@pytest.mark.slow
def test_a_scenario_with_a_radar_of_10_hz_alone(tmp_path: Path) -> None:
    file = tmp_path / "radar.yaml"
    file.write_text(
        "name: radar\ntruth: {source: scripted, duration_s: 5, rate_hz: 20, observer: {x: 30, y: -20, yaw_deg: 100},"
        " objects: {car: {start: {x: 50, speed_mps: 5}}}}\n"
        "sensors: {radar: {type: radar, rate_hz: 10, mount: {x_m: 2.5}, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, "
        "range_rate_sigma_mps: 0.1}}\n"
        "trackers: {ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}}\n"
    )
    of = find_tracker(f"{file}#ekf", {})
    assert of.observer == Carrier(30.0, -20.0, pytest.approx(np.deg2rad(100.0)))
    doctor = Doctor(of.sensors, observer=of.observer)
    found = doctor.examine(of.name, of.make)
    assert found.findings == []
    assert found.healthy
    assert set(not_made(found)) == {*NAMES, "same_instant"}
    for drive, _ in doctor._drives:
        assert np.diff(drive.time).min() == pytest.approx(0.1)


def test_a_pose_that_is_left_out_is_no_ego_motion() -> None:
    """Of a radar that stands elsewhere than at the origin."""
    probes = Probes().standing().placed([site_of(RADAR["radar"].mount, STANDING)])
    sensors = {name: simplified(sensor) for name, sensor in RADAR.items()}
    tracker = TrackerUnderTest(ignoring(PlainEkf), sensors, [], probes, 0, Assumptions(rest_reason="it stands"))
    found = expectation(tracker)
    assert "ego_motion" not in [check.name for check in found.checks]
    assert "ego_motion_ignored" not in [finding.fault for finding in found.findings]


@pytest.mark.parametrize("probe", [GENERAL[0], PASSING[0], Probes().moving[1]], ids=lambda probe: probe.name)
@pytest.mark.parametrize("observer", [STANDING, MOVING], ids=["standing", "moving"])
def test_a_sensor_measures_the_same_wherever_its_observer_is(probe: Probe, observer: Carrier) -> None:
    """Range, azimuth and range rate follow from the relative position and velocity alone."""
    site = site_of(RADAR["radar"].mount, observer)
    probe = probe if site.moving else probe.standing()
    plain = RADAR["radar"].model_copy(update={"mount": Mount()})
    for time in (-1.0, 0.0):
        own, other = probe.scan("", plain, time), probe.placed(site).scan("", RADAR["radar"], time)
        np.testing.assert_allclose(other.measurement, own.measurement, atol=1e-9)


def test_drives_without_misses_have_none() -> None:
    radar = {"radar": simplified(RADAR["radar"])}
    drives = {drive.name: drive for drive in simulate_drives(radar, 0, Setting(no_misses=True, own_rates=True))}
    assert all(scan.valid.all() for drive in drives.values() for scan in drive.scans)
    assert np.diff(drives["long_gap"].time).max() == pytest.approx(4.1)


class Constant:
    """Always the same estimate."""

    def step(self, state: Any, scan: Scan) -> Any:
        return 1, Estimate(np.array([1.0, 2.0, 3.0, 4.0]), np.eye(4))


def test_without_misses_the_last_estimate_is_moved_by_its_velocity() -> None:
    scan = GENERAL[0].scan("lidar", SENSORS["lidar"], 0.0)
    session = TrackerSession(TrackerFactory(Constant, no_misses=True))
    session.step(scan)
    with pytest.raises(MissGiven):
        session.copy().step(empty_scan(scan))
    moved = session.predict(scan._replace(time=0.5))
    assert moved is not None
    np.testing.assert_allclose(moved.mean, [2.5, 4.0, 3.0, 4.0])
    np.testing.assert_allclose(moved.covariance[0, [0, 2]], [1.25, 0.5])


@pytest.mark.slow
def test_skipped_checks_are_listed_and_not_made() -> None:
    skip = ("gain.radar", "long_run")
    found = Doctor(SENSORS, skip=skip).examine("mine", changed(PlainEkf, lambda scan: scan))
    assert {check.name for check in found.checks if check.skipped} == set(skip)
    assert not_made(found) == dict.fromkeys(skip, "skipped (--skip)")
    assert examination_verdict(found) == "mine: healthy but for 2 checks skipped"
    assert set(found.json()["checks"][0]) == {"name", "question", "passed", "skipped", "result", "faults"}


@pytest.mark.parametrize(
    ("skip", "left"),
    [
        ("process_noise", ["q_constant_per_step"]),
        ("noise_per_step", ["q_too_large"]),
        ("gain", ["q_too_large", "q_constant_per_step"]),
    ],
)
def test_the_finding_of_a_skipped_check_is_dropped_and_others_stay(skip: str, left: list[str]) -> None:
    assumed = Assumptions(skip=(skip,))
    found = PartResult(
        [check("process_noise", False), check("noise_per_step", False)],
        [Finding("q_too_large", 0.9, ""), Finding("q_constant_per_step", 0.9, "")],
    )
    applied = assumed.apply(
        found, assumed.left_out(check_named("growth_by_noise"), ["radar"]), check_named("growth_by_noise")
    )
    assert [finding.fault for finding in applied.findings] == left
    assert [check.name for check in applied.checks if check.passed is False] == [
        name for name in ("process_noise", "noise_per_step") if name != skip
    ]


def test_the_findings_of_one_sensor_can_be_skipped() -> None:
    found = PartResult([], [Finding("r_too_large", 0.9, "", sensor=name) for name in ("lidar", "radar")])
    applied = Assumptions(skip=("gain.radar",)).apply(found, [], check_named("gain"))
    assert [one.sensor for one in applied.findings] == ["lidar"]


def check(name: str, passed: bool | None, *, skipped: bool = False, why: str = "why") -> CheckResult:
    return CheckResult(name, "Is it so?", passed, why, skipped)


def test_the_observer_of_a_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    assert find_tracker("ekf", {"motion": "cv", "acceleration_sigma_mps2": 3.0}).observer is None
    fixed = find_tracker("scenarios/roundabout.yaml#ekf_cv", {}).observer
    assert fixed == Carrier(-34.0, 34.0, pytest.approx(-np.pi / 4))
    assert fixed is not None
    assert not fixed.moves

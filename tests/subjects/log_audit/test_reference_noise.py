"""The audit of logs with noise in the reference, and of logs without labels."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.exported import write_scenes
from tests.support.recorded_log import WALKERS, Errors, write_log

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.sensing.detections import FALSE_ALARM
from trackbench.subjects.log_audit.api import audit
from trackbench.truth.recorded.drive import Motion
from trackbench.truth.recorded.robust import body_sigmas, clipped, white_sigma

SMALL = Errors(
    time_offset_s=0.03,
    mount={"yaw_deg": 1.0},
    truly={"range_sigma_m": 0.45, "azimuth_sigma_deg": 0.75, "range_rate_sigma_mps": 0.15},
)


@pytest.mark.parametrize(
    ("truth_hz", "truth_from", "sigma"), [(20, 0, 0.05), (20, 2, 0.1), (10, 0, 0.1)], ids=["rows", "between", "both"]
)
def test_a_noisy_reference_is_no_error_of_the_sensors(
    tmp_path: Path, truth_hz: int, truth_from: int, sigma: float
) -> None:
    noisy = {"truth_hz": truth_hz, "truth_from": truth_from, "truth_sigma_m": sigma}
    item = audit(write_log(tmp_path, objects=WALKERS, moving=False, lidar=Errors(), **noisy))
    assert item.findings == ()
    for sensor in item.sensors.values():
        low, high = sensor.fit.estimates["time_offset"].interval.bounds(0.999)
        assert low < 0 < high
        # Least squares lie half way to the next row of the reference, 25 or 50 ms away.
        assert abs(sensor.fit.errors["time_offset"]) < 0.01
        assert sensor.square_before == pytest.approx(1, abs=0.08)


def test_small_errors_are_found_beside_a_noisy_reference(tmp_path: Path) -> None:
    item = audit(write_log(tmp_path, objects=WALKERS, moving=False, radar=SMALL, truth_sigma_m=0.1))
    # At the walkers' nearly steady speed, 30 ms are as well a point of the body 4 cm behind.
    assert {finding.kind for finding in item.findings} == {"undecided", "mount_yaw", "sigma"}
    (undecided,) = [finding for finding in item.findings if finding.candidates]
    assert undecided.candidates["time_offset"] == pytest.approx(0.03, abs=0.01)
    assert {finding.component for finding in item.findings} == {None, "range", "azimuth", "range_rate"}
    estimates = item.sensors["radar"].fit.estimates
    for name, value in (("time_offset", 0.03), ("mount_yaw", math.radians(1))):
        low, high = estimates[name].interval.bounds(0.999)
        assert low < value < high


def test_sigma_without_the_noise_of_the_reference() -> None:
    random = np.random.default_rng(3)
    added = random.uniform(0, 4, 20000)
    values = 1 + random.normal(size=20000) * np.sqrt(0.25 + added)
    values[:200] = 50
    middle, sigma = clipped(values, added)
    assert middle == pytest.approx(1, abs=0.03)
    assert sigma == pytest.approx(0.5, rel=0.06)


def test_the_noise_of_rows_is_estimated_beside_their_motion() -> None:
    random, time = np.random.default_rng(2), np.arange(0, 200, 0.1)
    motion = np.stack([20 * np.cos(0.4 * time), 20 * np.sin(0.4 * time)])
    vx, vy = -8 * np.sin(0.4 * time), 8 * np.cos(0.4 * time)
    assert white_sigma(motion) < 1e-3
    px, py = motion + random.normal(0, 0.05, motion.shape)
    assert body_sigmas(Motion(time, px, py, vx, vy))[0] == pytest.approx(0.05, rel=0.06)
    # Of positions once a second, what the velocity says is taken out first.
    slow = Motion(time[::10], px[::10], py[::10], vx[::10], vy[::10])
    assert body_sigmas(slow)[0] == pytest.approx(0.05, rel=0.25)
    # A velocity that was made of the positions has sqrt(1/2) of their noise in an interval.
    made = Motion(time, px, py, np.gradient(px, time), np.gradient(py, time))
    assert body_sigmas(made) == (pytest.approx(0.05, rel=0.06), pytest.approx(0.05 / (np.sqrt(2) * 0.1), rel=0.06))


TEXT = """\
name: street
truth:
  source: scripted
  duration_s: 30
  rate_hz: 10
  observer: {x: 0, y: 0, yaw_deg: 20, vx_mps: 3, vy_mps: 1, turn_rate_degps: 4}
  objects:
    car: {start: {x: 25, y: -6, speed_mps: 9, course_deg: 10}, pieces: [{for_s: 30, turn_rate_degps: 12}]}
    cyclist: {start: {x: 15, y: 12, speed_mps: 5, course_deg: -60}, pieces: [{for_s: 30, turn_rate_degps: -20}]}
    van: {start: {x: -30, y: 20, speed_mps: 7, course_deg: 0}, pieces: [{for_s: 30, turn_rate_degps: -9}]}
sensing: {identities: hidden}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1,
          max_range_m: 120, detection_probability: 0.8, clutter: {per_scan: 4}}
trackers:
  gnn: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}
monte_carlo: {runs: 1, seed: 3}
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The scenario of a log, and its detections with where they came from."""
    file, made = write_scenes(tmp_path_factory.mktemp("street"), tb.load(TEXT))
    return file, made[0][1]


def test_detections_near_boxes_are_measurements(log: tuple[Path, Any]) -> None:
    file, hidden = log
    found = tb.audit(file)
    radar = found.sensors["radar"]
    item = radar.unlabelled
    assert item is not None
    pairs = zip(hidden.scans, hidden.origins, strict=True)
    false = sum(int((origins[scan.valid[:, 0], 0] == FALSE_ALARM).sum()) for scan, origins in pairs)
    every = sum(int(scan.valid.sum()) for scan in hidden.scans)
    assert item.scans == len(hidden.scans)
    assert item.per_scan.value * item.scans == pytest.approx(every)
    # A few false alarms are within the gate of an object that was missed.
    assert 0.97 * false < item.others.value * item.scans <= false + 2
    assert item.near.value == pytest.approx(1 - item.others.value * item.scans / every)
    # Of intervals that hold in 999 of 1,000 logs.
    assert not item.others.excludes(4, 0.999)
    assert item.stated_others == pytest.approx(4)
    assert not radar.detections.share.excludes(0.8, 0.999)
    for noise, sigma in zip(radar.noise, (0.3, np.deg2rad(0.5), 0.1), strict=True):
        assert not noise.sigma.excludes(sigma, 0.999)
        assert noise.sigma.value == pytest.approx(sigma, rel=0.12)
    assert found.findings == ()


def test_the_command_tells_it_and_finds_late_stamps(
    log: tuple[Path, Any], tmp_path: Path, cli: Callable[..., Any]
) -> None:
    late = log[0].parent / "late.yaml"
    late.write_text(log[0].read_text().replace("azimuth: azimuth", "azimuth: azimuth\n      time_offset_s: 0.08"))
    done = cli("audit", late, "--json")
    assert done.status == 1
    found = json.loads(done.out)
    (late_stamps,) = [finding for finding in found["findings"] if finding["kind"] == "time_offset"]
    assert late_stamps["value"] == pytest.approx(-0.08, abs=0.02)
    own = found["sensors"]["radar"]["unlabelled"]
    assert {*own} == {"scans", "per_scan", "near", "others", "stated_others"}
    assert own["near"]["ci95"][0] < own["near"]["value"] < own["near"]["ci95"][1]
    shown = cli("audit", log[0])
    assert shown.status == 0
    assert "near a box, %" in shown.out
    assert max(map(len, shown.out.splitlines())) <= 80


def test_a_log_that_is_somewhere_else_is_one_line(log: tuple[Path, Any]) -> None:
    away = log[0].parent / "away.yaml"
    away.write_text(log[0].read_text().replace("range: range", "range: range:km"))
    with pytest.raises(InputError, match=r"no detection is within 5 m of a box: check times, frames and units"):
        tb.audit(away)


def test_of_azimuths_that_count_the_other_way_no_noise_is_judged(log: tuple[Path, Any]) -> None:
    folder = log[0].parent
    with (folder / "00_radar.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (folder / "00_turned.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys())
        table.writeheader()
        table.writerows({**row, "azimuth": -float(row["azimuth"])} for row in rows)
    turned = folder / "turned.yaml"
    turned.write_text(log[0].read_text().replace("_radar.csv", "_turned.csv"))
    assert [finding.kind for finding in tb.audit(turned).findings] == ["sign", "elsewhere"]

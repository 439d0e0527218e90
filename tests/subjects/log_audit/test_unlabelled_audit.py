"""The audit of detections that nobody labelled, against what is known of where they came from."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.exported import write_scenes

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.sensing.detections import FALSE_ALARM

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
    assert sum(band.count for band in item.bands) == round(item.others.value * item.scans)
    assert not radar.detections.share.excludes(0.8, 0.999)
    for noise, sigma in zip(radar.noise, (0.3, np.deg2rad(0.5), 0.1), strict=True):
        assert not noise.sigma.excludes(sigma, 0.999)
        assert not noise.mean.excludes(0, 0.999)
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
    assert {*own} > {"gate_m", "scans", "detections_per_scan", "near_share", "others_per_scan", "bands"}
    assert own["near_share"]["ci95"][0] < own["near_share"]["value"] < own["near_share"]["ci95"][1]
    shown = cli("audit", log[0])
    assert shown.status == 0
    assert "near a box, %" in shown.out
    assert max(map(len, shown.out.splitlines())) <= 80


def test_a_log_that_is_somewhere_else_is_one_line(log: tuple[Path, Any]) -> None:
    away = log[0].parent / "away.yaml"
    away.write_text(log[0].read_text().replace("azimuth: azimuth", "azimuth: azimuth\n      units: {range: km}"))
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

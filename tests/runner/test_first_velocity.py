"""A warning where the first scans contradict the velocity that tracks are said to start with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.results import Result

SCENARIO = """\
name: first
truth:
  source: scripted
  duration_s: {duration}
  rate_hz: {rate}
  objects:
    a: {{start: {{x: 20000, y: 20000, speed_mps: {speed}, course_deg: 30}}}}
    b: {{start: {{x: -20000, y: 20000, speed_mps: {speed}, course_deg: 100}}}}
sensors:
  radar: {{type: {sensor}, rate_hz: {rate}}}
trackers:
  default: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1}}
  also: {{filter: kf, motion: cv, acceleration_sigma_mps2: 2, initial: {{velocity: zero}}}}
  fitting: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1, initial: {{velocity_sigma_mps: 210}}}}
  differences: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1, initial: two_measurements}}
  stated: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1, initial: {{covariance_diag: [1, 1, 1, 1]}}}}
monte_carlo: {{runs: 10, seed: 3}}
score: {{settle_s: 0}}
"""
NOTE = "initial.velocity_sigma_mps is 20, but the first positions say some 300 m/s in most tracks; 210"
LIDAR = "lidar, position_sigma_m: 100"
RADAR = "radar, range_sigma_m: 30, azimuth_sigma_deg: 0.1, range_rate_sigma_mps: 1"


@pytest.fixture
def done(tmp_path: Path, cli: Callable[..., Any]) -> Callable[..., tuple[Result, str]]:
    def run(**values: object) -> tuple[Result, str]:
        path = tmp_path / "first.yaml"
        path.write_text(SCENARIO.format(**{"duration": 50, "rate": 1, **values}), encoding="utf-8")
        made = cli("run", path, "--no-recording", "--out", tmp_path, "--in-process")
        assert made.status == 0, made.err
        report = (tmp_path / "first" / "report.md").read_text(encoding="utf-8")
        words = " ".join(made.out.split())
        assert ("velocity_sigma_mps is" in words) == ("velocity_sigma_mps is" in report)
        return Result.load(tmp_path / "first"), words

    return run


def test_aircraft_contradict_the_usual_first_velocity_and_it_is_said_once(done: Callable[..., Any]) -> None:
    result, words = done(speed=300, sensor=LIDAR)
    stating = {item.name: item.first_velocity for item in result.summary.trackers}
    assert {name for name, first in stating.items() if first is not None} == {"default", "also"}
    assert stating["default"].share > 0.9
    assert stating["default"].typical_mps == pytest.approx(300, rel=0.2)
    assert words.count("velocity_sigma_mps is") == 1
    assert NOTE in words
    assert {"default", "also"} <= set(words.split(NOTE)[0].replace(":", " ").split()[-3:])


@pytest.mark.parametrize(
    ("speed", "sensor"), [(30, LIDAR), (60, LIDAR), (30, RADAR), (5, "lidar, position_sigma_m: 0.1")]
)
def test_cars_do_not(done: Callable[..., Any], speed: float, sensor: str) -> None:
    result, words = done(speed=speed, sensor=sensor)
    assert all(item.first_velocity is None for item in result.summary.trackers)
    assert "velocity_sigma_mps is" not in words


def test_it_is_said_of_trackers_of_several_objects_too(tmp_path: Path, cli: Callable[..., Any]) -> None:
    gnn = "{filter: kf, motion: cv, acceleration_sigma_mps2: 1, associate: {method: gnn}"
    several = f"  default: {gnn}}}\n  fitting: {gnn}, initial: {{velocity_sigma_mps: 210}}}}\n"
    for speed, contradicting in ((300, {"default"}), (60, set())):
        text = SCENARIO.format(duration=50, rate=1, speed=speed, sensor=LIDAR)
        begin, end = text[: text.index("trackers:")], "monte_carlo: {runs: 10, seed: 3}\n"
        path = tmp_path / "first.yaml"
        path.write_text(f"{begin}sensing: {{identities: hidden}}\ntrackers:\n{several}{end}", encoding="utf-8")
        made = cli("run", path, "--no-recording", "--out", tmp_path, "--in-process")
        assert made.status == 0, made.err
        trackers_of = Result.load(tmp_path / "first").summary.trackers
        assert {item.name for item in trackers_of if item.first_velocity is not None} == contradicting
        assert ("velocity_sigma_mps is" in " ".join(made.out.split())) is bool(contradicting)
        report = (tmp_path / "first" / "report.md").read_text(encoding="utf-8")
        assert ("velocity_sigma_mps is" in report) is bool(contradicting)


def test_what_a_range_rate_tells_is_no_contradiction(done: Callable[..., Any]) -> None:
    """Along the line of sight the first velocity is measured; across it 300 m/s are as unlikely as before."""
    text = SCENARIO.replace("course_deg: 30", "course_deg: 45").replace("course_deg: 100", "course_deg: 135")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(globals(), "SCENARIO", text)
        result, _ = done(speed=300, sensor=RADAR)
    assert {item.name for item in result.summary.trackers if item.first_velocity is not None} == {"also"}

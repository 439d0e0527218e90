"""Scenarios whose truth is recorded, from the file to the result."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from tests.support.udacity import synthetic_lines

from trackbench.base.errors import InputError
from trackbench.cli.commands import cli
from trackbench.report.console import run_in_words
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

LINES = synthetic_lines(60)
LIDAR = {"type": "lidar", "position_sigma_m": 0.15}
RADAR = {"type": "radar", "range_sigma_m": 0.3, "azimuth_sigma_deg": 1.7, "range_rate_sigma_mps": 0.3}
EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}
UDACITY = {
    "name": "recorded",
    "truth": {"source": "recording", "format": "udacity", "path": "log.txt"},
    "sensors": {"lidar": LIDAR, "radar": RADAR},
    "trackers": {"raw": {"use": "raw"}, "ekf": EKF},
    "monte_carlo": {"runs": 1},
}
TABLE = {
    "source": "recording",
    "format": "csv",
    "path": "log.csv",
    "columns": {"time": "t", "px": "x", "py": "y", "vx": "u", "vy": "v"},
}


def write(folder: Path, scenario: dict[str, object], lines: list[str] = LINES) -> Path:
    (folder / "log.txt").write_text("\n".join(lines))
    times = np.cumsum(np.tile([0.02, 0.05, 0.031], 30))
    rows = ["t,x,y,u,v,a,b", *(f"{t!r},{3 * t!r},{10 - t!r},3,-1,{3 * t!r},{10 - t!r}" for t in map(float, times))]
    (folder / "log.csv").write_text("\n".join(rows))
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(scenario))
    return file


def result(file: Path) -> Result:
    loaded = load_scenario(file)
    return run_scenario(loaded, truths_of(loaded))


def problems(file: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_scenario(file)
    return str(caught.value)


def test_recorded_measurements_reach_the_trackers_unchanged(tmp_path: Path) -> None:
    found = result(write(tmp_path, UDACITY))
    rows = found.tables["measurements"].to_pydict()
    assert len(rows["time_s"]) == len(LINES)
    for row, line in enumerate(LINES):
        values = [float(value) for value in line.split()[1:3]]
        assert [rows["z0"][row], rows["z1"][row]] == pytest.approx(values, rel=1e-12)
        assert rows["sensor"][row] == {"L": "lidar", "R": "radar"}[line[0]]
    assert found.json()["sensors"]["lidar"]["detection_rate"] == 1.0
    truth = found.json()["truth"]
    assert (truth["source"], truth["format"], truth["lines"]) == ("recording", "udacity", len(LINES))
    assert not any(tracker["failed"] for tracker in found.json()["trackers"])


def test_a_dropout_silences_a_recorded_sensor(tmp_path: Path) -> None:
    sensors = {"lidar": {**LIDAR, "dropouts": [{"from_s": 1, "to_s": 2}]}, "radar": RADAR}
    rows = result(write(tmp_path, {**UDACITY, "sensors": sensors})).tables["measurements"].to_pydict()
    silent = [
        time for time, valid, sensor in zip(rows["time_s"], rows["valid"], rows["sensor"], strict=True) if not valid
    ]
    assert silent
    assert all(1 <= time < 2 for time in silent)


def test_truth_alone_gets_synthetic_measurements_at_its_own_irregular_times(tmp_path: Path) -> None:
    sensors = {"lidar": {**LIDAR, "rate_hz": 10}, "radar": {**RADAR, "rate_hz": 10}}
    scenario = {**UDACITY, "truth": TABLE, "sensors": sensors, "monte_carlo": {"runs": 20}}
    found = result(write(tmp_path, scenario))
    entries = {item["name"]: item for item in found.json()["trackers"]}
    assert entries["ekf"]["metrics"]["position_rmse"]["value"] < 0.3
    times = found.tables["truth"].to_pydict()["time_s"]
    read = found.tables["measurements"].to_pydict()["time_s"]
    assert set(read) <= set(times)
    # At least a period lies between two measurements, but for the rounding up to a recorded time.
    assert len(set(read)) == pytest.approx(10 * max(times), abs=2)


def test_recorded_and_synthetic_measurements_mix(tmp_path: Path) -> None:
    truth = {**TABLE, "readings": {"lidar": {"x": "a", "y": "b"}}}
    sensors = {"lidar": LIDAR, "radar": {**RADAR, "rate_hz": 10}}
    found = result(write(tmp_path, {**UDACITY, "truth": truth, "sensors": sensors, "monte_carlo": {"runs": 5}}))
    assert found.json()["truth"]["recorded"] == ["lidar"]
    rows = found.tables["measurements"].to_pydict()
    lidar = [i for i, name in enumerate(rows["sensor"]) if name == "lidar"]
    np.testing.assert_allclose([rows["z1"][i] for i in lidar], [10 - rows["z0"][i] / 3 for i in lidar])
    assert len(lidar) < len(rows["sensor"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"monte_carlo": {"runs": 5}},
            "monte_carlo.runs: must be 1, not 5: all measurements are recorded, so every run",
        ),
        ({"sensors": {"one": LIDAR, "two": LIDAR}}, "sensors.two: the recording has one lidar, and it feeds one"),
        (
            {"sensors": {"lidar": {**LIDAR, "rate_hz": 10}}},
            "sensors.lidar.rate_hz: the measurements of lidar are recorded and taken as they are; remove",
        ),
        *(
            (
                {"sensors": {"lidar": {**LIDAR, **preset, "occlusion": True}}},
                "sensors.lidar.occlusion: the measurements of lidar are recorded and taken as they are; remove",
            )
            for preset in ({}, {"preset": "velodyne_vlp16"})
        ),
        ({"truth": TABLE}, "sensors.lidar.rate_hz: missing; measurements per second, Hz"),
        (
            {"truth": {**TABLE, "readings": {"lidar": {"x": "a", "y": "b", "bias": {"z": 1}}}}},
            "truth.readings.lidar.z: sensor lidar is a lidar, which reads x, y",
        ),
        (
            {"truth": {**TABLE, "readings": {"lidar": {"x": "a"}}}},
            "truth.readings.lidar.y: missing: a lidar reads x, y",
        ),
        ({"truth": {**UDACITY["truth"], "readings": {}}}, "truth.readings: format udacity has fixed columns and units"),
        ({"truth": {"source": "recording", "format": "csv", "path": "a"}}, "truth.columns: missing: format csv needs"),
        (
            {"truth": {**TABLE, "columns": {"time": "t", "px": "x", "py": "y"}}},
            "truth.columns: the velocity is missing: write vx and vy, or speed and course",
        ),
        (
            {"truth": {**TABLE, "columns": {"time": "t", "px": "x", "py": "y", "vx": "u"}}},
            "truth.columns: a velocity is either vx and vy, or speed and course",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, change: dict[str, object], message: str) -> None:
    assert message in problems(write(tmp_path, {**UDACITY, **change}))


def test_runs_from_drawn_starts_differ_and_are_allowed(tmp_path: Path) -> None:
    trackers = {"ekf": {**EKF, "initial": "truth"}}
    found = result(write(tmp_path, {**UDACITY, "trackers": trackers, "monte_carlo": {"runs": 3}}))
    assert len(set(found.tables["runs"].to_pydict()["position_rmse_m"])) == 3


def test_check_reads_the_recording_too(tmp_path: Path) -> None:
    file = write(tmp_path, UDACITY)
    (tmp_path / "log.txt").unlink()
    done = CliRunner().invoke(cli, ["check", str(file)], standalone_mode=False)
    assert isinstance(done.exception, InputError)
    assert "there is no file log.txt" in str(done.exception)


def drive(folder: Path) -> Path:
    """Two cars for 20 s before a radar; one leaves its field of view, and half of the scans miss either."""
    random = np.random.default_rng(5)
    truth, radar = ["t,who,x,y,u,v"], ["t,who,r,az,rr"]
    for k in range(401):
        t = 0.05 * k
        for who, x, y, u in (("near", 20 + 2 * t, 1.0, 2.0), ("gone", 30 - 4 * t, 5.0, -4.0)):
            truth.append(f"{t:.3f},{who},{x},{y},{u},0")
            azimuth, r = np.arctan2(y, x), np.hypot(x, y)
            if abs(azimuth) < np.deg2rad(60) and 1 < t < 18 and random.random() < 0.5:
                radar.append(f"{t:.3f},{who},{r + random.normal(0, 0.3)},{azimuth},{u * x / r}")
    (folder / "truth.csv").write_text("\n".join(truth))
    (folder / "radar.csv").write_text("\n".join(radar))
    columns = {"time": "t", "object": "who", "px": "x", "py": "y", "vx": "u", "vy": "v"}
    readings = {"radar": {"path": "radar.csv", "range": "r", "azimuth": "az", "range_rate": "rr"}}
    source = {"source": "recording", "format": "csv", "path": "truth.csv", "columns": columns, "readings": readings}
    scenario = {**UDACITY, "truth": source, "sensors": {"radar": {**RADAR, "fov_deg": 120}}}
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(scenario))
    return file


def test_rate_and_detections_are_measured(tmp_path: Path) -> None:
    found = result(drive(tmp_path))
    radar = found.summary.sensors["radar"]
    assert radar.rate_hz == pytest.approx(20, rel=1e-6)
    # Of about 340 scans with the one in view and 130 with the other, each seen in half: three sigma.
    assert radar.detection_rate == pytest.approx(0.5, abs=3 * 0.5 / np.sqrt(470))


def test_what_is_scored_is_said(tmp_path: Path) -> None:
    found = result(drive(tmp_path))
    score = found.summary.score
    assert found.summary.truth.duration_s == pytest.approx(20)
    assert (score.from_s, score.to_s) == (pytest.approx(1, abs=0.3), pytest.approx(18, abs=0.3))
    lines = run_in_words(found)
    assert f"20.0 s ({score.from_s:.1f} to {score.to_s:.1f} s scored)" in lines
    # Scans without a detection are instants at which a tracker is asked, by prediction.
    times = np.array(found.tables["steps"].to_pydict()["time_s"])
    assert np.diff(np.unique(times)).max() < 0.051

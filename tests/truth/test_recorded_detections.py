"""Recordings of detections without a truth, from the file to the result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.base.errors import InputError
from trackbench.base.types import FieldOfView, RecordedDetections, Scan, Tracks
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.without_truth import judged_scan
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

RADAR = {
    "type": "radar",
    "range_sigma_m": 0.3,
    "azimuth_sigma_deg": 0.5,
    "range_rate_sigma_mps": 0.2,
    "fov_deg": 60,
    "max_range_m": 150,
    "states": {"detection_probability": 0.95, "clutter_per_scan": 0.5},
}
COLUMNS = {"path": "radar.csv", "time": "t", "x": "x", "y": "y", "range_rate": "v", "slot": "s", "new_track": "new"}
EGO = {"path": "ego.csv", "time": "t", "px": "e", "py": "n", "yaw": "yaw"}
GNN = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 1, "associate": {"method": "gnn"}}
HEADER = "t,s,x,y,v,new"


def scenario(readings: dict[str, Any] | None = None, **truth: Any) -> dict[str, Any]:
    columns = {key: value for key, value in {**COLUMNS, **(readings or {})}.items() if value is not None}
    source = {"source": "recording", "format": "csv", "ego": EGO, "readings": {"radar": columns}, **truth}
    return {
        "name": "scans",
        "truth": source,
        "sensing": {"identities": "hidden"},
        "sensors": {"radar": RADAR},
        "trackers": {"gnn": GNN},
        "monte_carlo": {"runs": 1},
    }


def drive(lost: range = range(0), renewed: int = -1) -> list[str]:
    """Two cars 20 m and 50 m ahead for 10 s at 20 Hz, the sensor itself at 10 m/s along y.

    Rows of a cycle are 3 ms apart. The near car is not listed in the cycles ``lost``, and its slot says at cycle
    ``renewed`` that it took a new object.
    """
    rows = []
    for k in range(200):
        t = 0.05 * k
        if k not in lost:
            rows.append(f"{t:.4f},8,20,2,0,{int(k == renewed)}")
        rows.append(f"{t + 0.003:.4f},9,{50 - 0.1 * k:.3f},-3,-2,0")
    return rows


def write(folder: Path, content: dict[str, Any], rows: list[str] | None = None, header: str = HEADER) -> Path:
    (folder / "radar.csv").write_text("\n".join([header, *(drive() if rows is None else rows)]))
    ego = ["t,e,n,yaw", *(f"{0.1 * k:.1f},0,{k:.1f},{np.pi / 2!r}" for k in range(102))]
    (folder / "ego.csv").write_text("\n".join(ego))
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def recorded(file: Path) -> RecordedDetections:
    found = truths_of(load_scenario(file))[0]
    assert found.measurements is not None
    detections = found.measurements["radar"]
    assert isinstance(detections, RecordedDetections)
    return detections


def result(file: Path) -> Result:
    loaded = load_scenario(file)
    return run_scenario(loaded, truths_of(loaded))


def refused(file: Path) -> str:
    with pytest.raises(InputError) as caught:
        truths_of(load_scenario(file))
    return str(caught.value)


def test_the_rows_of_a_cycle_are_a_scan(tmp_path: Path) -> None:
    file = write(tmp_path, scenario())
    found = recorded(file)
    truth = truths_of(load_scenario(file))[0].truth
    np.testing.assert_allclose(truth.time[found.steps], 0.05 * np.arange(200))
    np.testing.assert_array_equal(np.bincount(found.scan), np.full(200, 2))
    expected = [np.hypot(20, 2), np.arctan2(2, 20), 0]
    np.testing.assert_allclose(found.measurement[:, found.own_track == 0], np.tile(expected, (200, 1)).T)
    assert found.own_tracks == ("8-1", "9-1")
    assert truth.ids == ()
    assert not truth.known
    np.testing.assert_allclose(truth.observer.vy, 10, atol=1e-9)


def test_a_cycle_without_a_row_is_an_empty_scan(tmp_path: Path) -> None:
    rows = [row for row in drive() if not 2.4 < float(row.split(",")[0]) < 2.56]
    found = recorded(write(tmp_path, scenario(), rows))
    assert len(found.steps) == 200
    np.testing.assert_array_equal(np.flatnonzero(np.bincount(found.scan, minlength=200) == 0), [49, 50, 51])


def test_a_slot_has_another_track_where_it_says_so_and_after_a_long_gap(tmp_path: Path) -> None:
    assert recorded(write(tmp_path, scenario(), drive(renewed=50))).own_tracks == ("8-1", "8-2", "9-1")
    assert recorded(write(tmp_path, scenario(), drive(lost=range(40, 50)))).own_tracks == ("8-1", "9-1")
    assert recorded(write(tmp_path, scenario(), drive(lost=range(40, 61)))).own_tracks == ("8-1", "8-2", "9-1")


def test_without_slots_rows_of_one_time_are_a_scan(tmp_path: Path) -> None:
    rows = [f"{0.1 * (k // 3):.1f},0,{20 + k % 3},2,0,0" for k in range(30)]
    found = recorded(write(tmp_path, scenario({"slot": None, "new_track": None}), rows))
    np.testing.assert_array_equal(np.bincount(found.scan), np.full(10, 3))
    np.testing.assert_array_equal(found.own_track, -1)


def test_of_an_object_listed_twice_the_older_slot_is_kept(tmp_path: Path) -> None:
    copies = [f"{0.05 * k + 0.001:.4f},7,20.3,2.1,0,0" for k in range(100, 200)]
    file = write(tmp_path, scenario({"copies_within_m": 1}), drive() + copies)
    found = recorded(file)
    np.testing.assert_array_equal(np.bincount(found.scan), np.full(200, 2))
    assert set(found.own_track.tolist()) == {found.own_tracks.index("8-1"), found.own_tracks.index("9-1")}
    assert truths_of(load_scenario(file))[0].notes == (
        "radar: left out 100 rows that are copies of another of their cycle",
    )


def test_a_repeated_row_and_those_outside_the_observers_time_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = [*drive(), drive()[0], "10.3,8,20,2,0,0", "10.35,8,20,2,0,0"]
    assert truths_of(load_scenario(write(tmp_path, scenario(), rows)))[0].notes == (
        "radar: left out 1 rows of a slot and a time that came before",
        "radar: left out 2 rows outside the time of the observer",
    )


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,8,20,2,0,2"], "radar.csv:2: new is 2, where 0 or 1 is expected"),
        (["0,8,20,2,0,0", "0.05,8,20,,0,0"], "radar.csv:3: y is empty, but other columns of the same measurement"),
        (["0,8,,,,0"], "radar.csv: there is no measurement in"),
        (["500,8,20,2,0,0", "500.05,8,20,2,0,0"], ""),
        (["0,8,20,2,0,0", "9e9,8,20,2,0,0"], "radar.csv:3: t: "),
    ],
)
def test_a_damaged_row_is_named(tmp_path: Path, rows: list[str], message: str) -> None:
    if not message:
        message = "truth.ego: only 0 of 2 measurements (from 0 to 0.05 s) lie within the time of the truth or observer "
        message += "(from -500 to -489.9 s): check the units of time"
    assert message in refused(write(tmp_path, scenario(), rows))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensing": {"identities": "known"}}, "truth.path: missing: the file with the truth; without one, write"),
        (
            {"truth": scenario(ego={**EGO, "time": None})["truth"]},
            "truth.ego.time: missing: without a truth, the observer",
        ),
        ({"truth": scenario(observer={"x": 1})["truth"]}, "truth.observer: not used with ego"),
        (
            {"truth": scenario({"path": None})["truth"]},
            "truth.readings.radar: without a truth, it has a path",
        ),
        ({"truth": scenario({"object": "s"})["truth"]}, "truth.readings.radar: without a truth, it has a path"),
        ({"truth": scenario({"slot": None})["truth"]}, "truth.readings.radar.new_track: is of a slot"),
        ({"truth": scenario({"y": None})["truth"]}, "truth.readings.radar.y: missing: a radar reads x, y, range_rate"),
        ({"truth": scenario({"range": "x"})["truth"]}, "truth.readings.radar.range: sensor radar is a radar"),
        ({"truth": {"source": "recording", "format": "csv"}}, "truth.path: missing: the file with the truth"),
        ({"monte_carlo": {"runs": 5}}, "monte_carlo.runs: must be 1, not 5"),
        (
            {"sensors": {"radar": RADAR, "lidar": {"type": "lidar", "position_sigma_m": 1, "rate_hz": 10}}},
            "truth.readings: lidar is missing: nothing can be synthesised without a truth",
        ),
        (
            {"trackers": {"gnn": {**GNN, "associate": {"method": "oracle"}}}},
            "trackers.gnn.associate.method: oracle needs the object of each detection",
        ),
        (
            {"expect": [{"tracker": "gnn", "metric": "gospa", "below": 1}]},
            "expect.0.metric: there is no metric 'gospa'",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    assert message in refused(write(tmp_path, {**scenario(), **change}))


def test_the_result_says_what_can_be_told_and_what_cannot(tmp_path: Path) -> None:
    found = result(write(tmp_path, scenario()))
    summary = found.summary
    assert (summary.identities, summary.truth.known, summary.truth.objects) == ("hidden", False, [])
    assert found.differences == []
    metrics = found["gnn"].metrics
    for path in TRACK_METRICS:
        assert (metrics[path].value, metrics[path].reason) == (None, "there is no truth")
    # Two cars, each confirmed with its third detection; all detections from then on are used, and of each also those
    # of the scan that confirmed it.
    assert metrics["track_count"].value == pytest.approx(2 * 198 / 200)
    assert metrics["used_share"].value == pytest.approx(198 / 200)
    assert metrics["new_tracks"].value == pytest.approx(2 / (199 * 0.05 / 60))
    # Measurements without noise.
    assert 0 <= (metrics["nis"].value or 0) < 0.05


def test_nis_is_one_where_the_noise_is_as_stated(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    rows = []
    for k in range(1000):
        for slot, x, y in ((1, 60, 3), (2, 90, -8), (3, 30, 0)):
            r = np.hypot(x, y) + 0.3 * random.standard_normal()
            azimuth = np.arctan2(y, x) + np.deg2rad(0.5) * random.standard_normal()
            rate = 0.2 * random.standard_normal()
            rows.append(f"{0.01 * k:.3f},{slot},{r * np.cos(azimuth):.9f},{r * np.sin(azimuth):.9f},{rate:.9f},0")
    content = scenario()
    content["trackers"]["gnn"] = {**GNN, "acceleration_sigma_mps2": 0.01}
    metrics = result(write(tmp_path, content, rows))["gnn"]
    # 3,000 squares of 3 degrees of freedom: their mean has a standard deviation of sqrt(2 / 9,000).
    assert metrics.metrics["nis"].value == pytest.approx(1, abs=4 * np.sqrt(2 / 9000))


def test_the_prediction_score_is_the_poisson_score_of_the_predicted_intensity() -> None:
    config = load_sensor(RADAR)
    scan = Scan(
        time=0.0,
        sensor="radar",
        kind="radar",
        measurement=np.array([[50.0, 80.0], [0.0, 0.2], [0.0, 1.0]]),
        valid=np.ones(2, dtype=bool),
        noise_covariance=config.noise_covariance(),
        sensor_pose=np.zeros(3),
        sensor_velocity=np.zeros(2),
        arrival_time=0.0,
        detection_probability=0.9,
        clutter_density=0.0,
        field_of_view=FieldOfView(np.deg2rad(30), 150.0),
    )
    # One track where the first detection is, one behind the sensor, of which no detection is expected.
    mean, covariance = np.array([[50.0, -50.0], [0, 0], [0, 0], [0, 0]]), np.stack([np.eye(4)] * 2, axis=-1)
    before = Tracks(np.array([4, 5]), mean, covariance, np.array([0.8, 0.8]))
    after = before._replace(used=np.array([0, -1]))
    found = judged_scan(scan, config, before, after)
    slope = np.array([[1, 0, 0, 0], [0, 1 / 50, 0, 0], [0, 0, 1, 0]])
    spread = slope @ slope.T + config.noise_covariance()
    density = 1 / np.sqrt(np.linalg.det(2 * np.pi * spread))
    unpredicted = 1 / (150 * np.deg2rad(60) * 100)
    assert config.volume() == pytest.approx(1 / unpredicted)
    expected = np.log(unpredicted + 0.9 * 0.8 * density) + np.log(unpredicted) - 0.9 * 0.8 - 1
    assert found.log_score == pytest.approx(expected)
    np.testing.assert_allclose(found.nis, [0], atol=1e-12)
    # The detection two sigma in range from the track that used it.
    far = scan._replace(measurement=scan.measurement + np.array([[2 * np.sqrt(spread[0, 0])], [0], [0]]))
    np.testing.assert_allclose(judged_scan(far, config, before, after).nis, [4 / 3])


def load_sensor(options: dict[str, Any]) -> Sensor:
    return SENSOR_MODELS["radar"].model_validate(options)

"""Exports in MCAP: readable by others, and the bits that trackers get."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from tests.support.exported import HIDDEN, SCENARIO

from trackbench.api.scenario import load, sense, truth
from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.subjects.export.api import export
from trackbench.truth.formats.mcap import Mcap

make_reader = pytest.importorskip("mcap.reader").make_reader
RERUN = Path(sys.executable).with_name("rerun")
COMPONENTS = {"radar": ["range_m", "azimuth_rad", "range_rate_mps"], "lidar": ["x_m", "y_m"]}


def messages_in(file: Path) -> list[tuple[str, str, Any]]:
    """Topic, schema and message of each, which is as its schema says."""
    result = []
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            value = json.loads(message.data)
            jsonschema.validate(value, json.loads(schema.data))
            result.append((channel.topic, schema.name, value))
    return result


def arrived(text: str) -> list[Scan]:
    return sorted(sense(load(text), runs=range(1, 2)), key=lambda scan: (scan.arrival_time, scan.time))


@pytest.mark.parametrize("text", [SCENARIO, HIDDEN])
def test_scans_have_the_bits_that_trackers_get(tmp_path: Path, text: str) -> None:
    export(text, tmp_path / "scans", format="mcap")
    found = [
        value for _, schema, value in messages_in(tmp_path / "scans" / "scene0_run1.mcap") if schema.endswith("Scan")
    ]
    manifest = json.loads((tmp_path / "scans" / "manifest.json").read_text())
    for number, (message, scan) in enumerate(zip(found, arrived(text), strict=True)):
        assert (message["scene"], message["run"], message["scan"]) == (0, 1, number)
        assert message["fingerprint"] == manifest["fingerprints"][1]["fingerprint"]
        assert (message["time_s"], message["arrival_time_s"]) == (scan.time, scan.arrival_time)
        assert message["sensor_pose"] + message["sensor_velocity"] == [*scan.sensor_pose, *scan.sensor_velocity]
        assert message["noise_covariance"] == scan.noise_covariance.tolist()
        valid = scan.valid.reshape(-1)
        assert [row["valid"] for row in message["rows"]] == valid.tolist()
        measured = [[row[name] for name in COMPONENTS[scan.sensor]] for row in message["rows"] if row["valid"]]
        measurement = scan.measurement.reshape(len(scan.measurement), -1)[:, valid]
        assert measured == measurement.T.tolist()
        if text == HIDDEN:
            assert message["clutter_density"] == scan.clutter_density


def test_point_clouds_are_the_detections_in_the_frame_of_the_sensor(tmp_path: Path) -> None:
    export(HIDDEN, tmp_path / "scans", format="mcap")
    clouds = [item for item in messages_in(tmp_path / "scans" / "scene0_run1.mcap") if item[1] == "foxglove.PointCloud"]
    for (topic, _, cloud), scan in zip(clouds, arrived(HIDDEN), strict=True):
        assert (topic, cloud["frame_id"]) == (f"/{scan.sensor}/detections", scan.sensor)
        names = [field["name"] for field in cloud["fields"]]
        points = np.frombuffer(base64.b64decode(cloud["data"]), "<f8").reshape(-1, len(names))
        assert cloud["point_stride"] == 8 * len(names)
        rows = dict(zip(names, points.T, strict=True))
        if scan.sensor == "lidar":
            np.testing.assert_array_equal([rows["x"], rows["y"]], scan.measurement)
        else:
            np.testing.assert_array_equal(rows["azimuth"], scan.measurement[1])
            np.testing.assert_allclose(np.hypot(rows["x"], rows["y"]), scan.measurement[0], rtol=1e-3)
            np.testing.assert_allclose(np.arctan2(rows["y"], rows["x"]), scan.measurement[1], atol=1e-12)


def test_transforms_are_the_poses_of_the_sensors(tmp_path: Path) -> None:
    export(SCENARIO, tmp_path / "scans", format="mcap")
    found = [value for topic, _, value in messages_in(tmp_path / "scans" / "scene0_run1.mcap") if topic == "/tf"]
    for message, scan in zip(found, arrived(SCENARIO), strict=True):
        carried, move = message["transforms"]
        assert [item["parent_frame_id"] for item in (carried, move)] == ["world", "observer"]
        assert [item["child_frame_id"] for item in (carried, move)] == ["observer", scan.sensor]
        yaws = [2 * np.arctan2(item["rotation"]["z"], item["rotation"]["w"]) for item in (carried, move)]
        assert sum(yaws) == pytest.approx(scan.sensor_pose[2], abs=1e-12)
        assert [carried["translation"][key] for key in "xy"] == scan.sensor_pose[:2].tolist()
        assert move["translation"] == {"x": 0, "y": 0, "z": 0}


def test_the_truth_comes_back_from_its_boxes(tmp_path: Path) -> None:
    export(SCENARIO, tmp_path / "scans", tmp_path / "truth", format="mcap")
    moved = truth(load(SCENARIO))
    rows = Mcap().rows(tmp_path / "truth" / "scene0.mcap")
    for number, name in enumerate(moved.ids):
        own = rows.rows(np.flatnonzero(np.array(rows.id) == name))
        assert own.vx is not None
        assert own.heading is not None
        np.testing.assert_allclose(own.time, moved.time, atol=1e-9)
        np.testing.assert_array_equal(own.px, moved.px[:, number, 0])
        np.testing.assert_array_equal(own.vx, moved.vx[:, number, 0])
        np.testing.assert_allclose(own.heading, moved.heading[:, number, 0], atol=1e-12)
    assert [track.id for track in Mcap().read(tmp_path / "truth" / "scene0.mcap")] == ["car", "cyclist"]


@pytest.mark.parametrize("place", ["scans/scene0_run0.mcap", "truth/scene0.mcap"])
def test_reruns_own_reader_finds_nothing_wrong(tmp_path: Path, place: str) -> None:
    export(HIDDEN, tmp_path / "scans", tmp_path / "truth", format="mcap")
    checked = subprocess.run(
        [RERUN, "mcap", "check", "--full", tmp_path / place], capture_output=True, text=True, check=True
    )
    lines = [line.split() for line in checked.stdout.splitlines() if " /" in line]
    topics = {topic for topic, _, _ in messages_in(tmp_path / place)}
    assert {line[3]: line[0] for line in lines} == dict.fromkeys(topics, "ok")
    converted = subprocess.run(
        [RERUN, "mcap", "convert", tmp_path / place, "-o", tmp_path / "out.rrd"], capture_output=True, check=True
    )
    assert converted.returncode == 0
    assert (tmp_path / "out.rrd").stat().st_size > 1000


def test_without_the_package_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(InputError, match=r"pip install 'trackbench\[mcap\]'"):
        export(SCENARIO, tmp_path / "scans", format="mcap")
    assert not any(tmp_path.iterdir())

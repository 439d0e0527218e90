"""Logs in MCAP: what an export wrote comes back, frames, what detections may look like, and what is refused."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.support.exported import HIDDEN, SCENARIO
from tests.support.mcap_files import log_of, mounted

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.subjects.export.mcap import mcap_messages

pytest.importorskip("mcap", reason="needs trackbench[mcap]")


@pytest.mark.parametrize("text", [SCENARIO, HIDDEN])
def test_an_export_comes_back(tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    hidden, content = text == HIDDEN, mounted(text)
    written_scenario = yaml.safe_dump(content, sort_keys=False)
    tb.export(written_scenario, "scans", "truth", format="mcap")
    log = yaml.safe_dump(log_of(content, hidden=hidden), sort_keys=False)
    made = {(scan.sensor, round(scan.time, 6)): scan for scan in tb.sense(written_scenario, runs=range(1, 2))}
    back = {(scan.sensor, round(scan.time, 6)): scan for scan in tb.sense(log)}
    assert {*back} == {*made} if hidden else {*back} <= {*made}
    for key, scan in back.items():
        own = made[key]
        np.testing.assert_allclose(scan.sensor_pose, own.sensor_pose, atol=1e-12)
        np.testing.assert_allclose(scan.sensor_velocity, own.sensor_velocity, atol=1e-12)
        if hidden:
            # The order of detections means nothing.
            theirs, ours = (item.measurement[:, item.valid] for item in (own, scan))
            assert sorted(ours.T.tolist()) == sorted(theirs.T.tolist())
        else:
            np.testing.assert_array_equal(scan.valid, own.valid)
            np.testing.assert_array_equal(scan.measurement[:, scan.valid[:, 0]], own.measurement[:, own.valid[:, 0]])
    true, moved = tb.truth(log), tb.truth(written_scenario)
    at = np.searchsorted(true.time, moved.time - 1e-9)
    for name in ("px", "py", "vx", "vy"):
        np.testing.assert_allclose(getattr(true, name)[at], getattr(moved, name), atol=1e-12)


def test_a_log_without_a_truth_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    content = mounted(HIDDEN)
    tb.export(yaml.safe_dump(content), "scans", format="mcap")
    log = log_of(content, hidden=True)
    ego = log["truth"].pop("columns")["observer"]
    del log["truth"]["path"]
    log["truth"]["ego"] = ego
    scans = tb.sense(yaml.safe_dump(log))
    assert {scan.sensor for scan in scans} == {"radar", "lidar"}
    np.testing.assert_allclose(scans[0].sensor_pose[2] + np.radians(30), np.radians(30), atol=1e-9)


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """A log of a car ahead of a lidar, whose points are in a frame on a moving body, in seconds since 1970."""
    monkeypatch.chdir(tmp_path)
    turned = {"x": 0, "y": 0, "z": np.sin(np.pi / 4), "w": np.cos(np.pi / 4)}
    straight = {"x": 0, "y": 0, "z": 0, "w": 1}

    def at(k: int) -> dict[str, int]:
        return {"sec": 1_700_000_000 + k // 10, "nsec": k % 10 * 100_000_000}

    def move(k: int, parent: str, child: str, x: float, rotation: dict[str, float]) -> dict[str, Any]:
        own = {"timestamp": at(k), "parent_frame_id": parent, "child_frame_id": child, "rotation": rotation}
        return own | {"translation": {"x": x, "y": 0, "z": 0}}

    def cloud(k: int, points: list[tuple[float, float]], **changes: Any) -> dict[str, Any]:
        layout = np.dtype({"names": ["x", "y"], "formats": ["<f4", "<f8"], "offsets": [0, 4], "itemsize": 16})
        pose = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": straight}
        fields = [{"name": "x", "offset": 0, "type": 7}, {"name": "y", "offset": 4, "type": 8}]
        data = base64.b64encode(np.array(points, dtype=layout).tobytes()).decode()
        own = {"timestamp": at(k), "frame_id": "lidar", "pose": pose, "fields": fields, "data": data}
        return own | {"point_stride": 16} | changes

    def write(topics: tuple[str, ...] = ("/lidar",), frame: str = "body", **changes: Any) -> str:
        with mcap_messages(tmp_path / "log.mcap") as out:
            # The body looks along y; its mount is stated once.
            out("/tf", "foxglove.FrameTransforms", 0, {"transforms": [move(0, "base", "body", 1.0, straight)]})
            for k in range(20):
                out("/tf", "foxglove.FrameTransforms", k, {"transforms": [move(k, "map", "base", 5.0, turned)]})
                cube = {
                    "pose": {"position": {"x": 10 + k, "y": 2, "z": 0}, "orientation": straight},
                    "size": {"x": 4, "y": 2, "z": 1},
                }
                entity = {"timestamp": at(k), "frame_id": "body", "id": "car", "cubes": [cube]}
                stated = [{"key": "kind", "value": "car"}, {"key": "vx_mps", "value": "10"}]
                boxes = {"deletions": [], "entities": [entity | {"metadata": stated}]}
                out("/boxes", "foxglove.SceneUpdate", k, boxes)
                for topic in topics:
                    points = [] if k == 7 else [(8.5 + k, 2.25), (30.0, -5.0)]
                    out(topic, "foxglove.PointCloud", k, cloud(k, points, **changes))
        return f"""\
name: car
truth:
  source: recording
  format: mcap
  path: log.mcap
  columns: {{class: kind, observer: {{frame: {frame}}}}}
  readings: {{lidar: {{x: x, y: y}}}}
  reference: {{classes: [car]}}
sensing: {{identities: hidden}}
sensors: {{lidar: {{type: lidar, position_sigma_m: 0.15}}}}
trackers: {{gnn: {{filter: kf, motion: cv, acceleration_sigma_mps2: 3, associate: {{method: gnn}}}}}}
monte_carlo: {{runs: 1}}
"""

    return write


def test_points_and_boxes_in_moving_frames(car: Callable[..., str]) -> None:
    log = car()
    truth, scans = tb.truth(log), tb.sense(log)
    assert truth.target.tolist() == [True]
    # The body is 1 m ahead of base, which looks along y at x = 5; the car is 10 m and more ahead, and 2 m to the left.
    np.testing.assert_allclose(truth.px[:, 0, 0], 3.0, atol=1e-12)
    np.testing.assert_allclose(truth.py[:, 0, 0], 11.0 + np.arange(20), atol=1e-9)
    # A velocity that is stated in a moving frame is not one over ground.
    np.testing.assert_allclose(truth.vx[:, 0, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(truth.vy[:, 0, 0], 10.0, atol=1e-6)
    assert [scan.valid.sum() for scan in scans] == [2] * 7 + [0] + [2] * 12
    assert sorted(scans[3].measurement.T.tolist()) == [[11.5, 2.25], [30.0, -5.0]]
    np.testing.assert_allclose(scans[3].sensor_pose, [5.0, 1.0, np.pi / 2], atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"topics": ("/a", "/b")}, "2 topics have foxglove.PointCloud: name one in topic: /a, /b"),
        ({"topics": ()}, "there are no detections in this file; known are messages of foxglove.PointCloud"),
        ({"frame": "bod"}, "no transform has the child frame 'bod'; did you mean 'body'?"),
        ({"data": "AAAA"}, "message 1 of foxglove.PointCloud is damaged"),
        ({"data": "A"}, "message 1 of foxglove.PointCloud is damaged"),
        ({"point_stride": 10}, "message 1 of foxglove.PointCloud is damaged"),
        ({"point_stride": -1}, "message 1 of foxglove.PointCloud is damaged: -1 is no whole number"),
        ({"fields": [{"name": "x", "offset": 0, "type": 9}]}, "9 is no foxglove.NumericType"),
        ({"fields": [{"name": "r", "offset": 0, "type": 8}]}, "there is no column 'x'; choose from: r, time"),
        ({"pose": {"position": {"x": 1, "y": 0, "z": 0}}}, "have a pose of their own"),
    ],
)
def test_what_cannot_be_read_is_one_line(car: Callable[..., str], changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError) as caught:
        tb.truth(car(**changes))
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)

"""Exports as OSI: what its own reader gives back, and detections field by field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.support.exported import HIDDEN, SCENARIO

from trackbench.api.scenario import load, sense, truth
from trackbench.base.errors import InputError
from trackbench.subjects.export.api import export
from trackbench.truth.formats.osi import OsiTrace, _delimited, _fields


def message_in(content: memoryview) -> dict[int, list[object]]:
    """The values of each field by its number."""
    fields: dict[int, list[object]] = {}
    for number, value in _fields(content):
        fields.setdefault(number, []).append(value)
    return fields


def inside(content: memoryview, *numbers: int) -> memoryview:
    for number in numbers:
        (part,) = message_in(content)[number]
        assert isinstance(part, memoryview)
        content = part
    return content


def doubles(content: memoryview) -> list[object]:
    return [value for _, value in _fields(content)]


def seconds(content: memoryview) -> float:
    fields = dict(_fields(content))
    return fields[1] + 1e-9 * fields[2]


def sensor_data(file: Path) -> Iterator[memoryview]:
    yield from _delimited(memoryview(file.read_bytes()), file)


def test_the_truth_comes_back(tmp_path: Path) -> None:
    export(SCENARIO, tmp_path / "scans", tmp_path / "truth", format="osi")
    moved, rows = truth(load(SCENARIO)), OsiTrace().rows(tmp_path / "truth" / "scene0_gt_.osi")
    for number in range(2):
        own = rows.rows(np.flatnonzero(np.array(rows.id) == str(number + 1)))
        assert own.vy is not None
        np.testing.assert_allclose(own.time, moved.time, atol=1e-9)
        np.testing.assert_array_equal(own.py, moved.py[:, number, 0])
        np.testing.assert_array_equal(own.vy, moved.vy[:, number, 0])
    assert rows.covariance is None
    assert set(rows.kind or ()) == {"car"}


@pytest.mark.parametrize("text", [SCENARIO, HIDDEN])
def test_detections_are_those_that_trackers_get(tmp_path: Path, text: str) -> None:
    export(text, tmp_path / "scans", format="osi")
    every = sorted(sense(load(text), runs=range(1, 2)), key=lambda scan: (scan.arrival_time, scan.time))
    for place, (name, of_kind) in enumerate({"radar": 2, "lidar": 3}.items()):
        scans = [scan for scan in every if scan.sensor == name]
        messages = sensor_data(tmp_path / "scans" / f"scene0_run1_{name}_sd.osi")
        for message, scan in zip(messages, scans, strict=True):
            assert seconds(inside(message, 2)) == pytest.approx(scan.arrival_time, abs=1e-9)
            assert seconds(inside(message, 9)) == pytest.approx(scan.time, abs=1e-9)
            x, y, yaw = scan.sensor_pose
            assert [doubles(inside(message, 3, part)) for part in (2, 3, 4)] == [
                [x, y, 0.0],
                [0.0, 0.0, yaw],
                [*scan.sensor_velocity, 0.0],
            ]
            data = inside(message, 26, of_kind)
            assert seconds(inside(data, 1, 1)) == pytest.approx(scan.time, abs=1e-9)
            assert message_in(inside(data, 1, 7)).get(1) == [place]
            detections = message_in(data).get(2, [])
            measured = scan.measurement.reshape(len(scan.measurement), -1)[:, scan.valid.reshape(-1)]
            objects = np.flatnonzero(scan.valid.reshape(-1)) + 1
            for detection, own, number in zip(detections, measured.T, objects, strict=True):
                assert isinstance(detection, memoryview)
                if text == HIDDEN:
                    assert 2 not in message_in(detection)
                else:
                    assert message_in(inside(detection, 2))[1] == [number]
                spherical = doubles(inside(detection, 3))
                if name == "radar":
                    assert spherical == [*own[:2], 0.0]
                    assert message_in(detection)[5] == [own[2]]
                    assert doubles(inside(detection, 4))[0] == pytest.approx(0.3)
                else:
                    assert spherical == [np.hypot(*own), np.arctan2(own[1], own[0]), 0.0]


def test_a_sensor_that_osi_does_not_know_is_named(tmp_path: Path) -> None:
    text = SCENARIO.replace("type: radar", "type: speed_radar").replace("range_rate_sigma", "speed_sigma")
    with pytest.raises(InputError, match=r"sensors\.radar\.type: OSI has no detections of a speed_radar"):
        export(text, tmp_path / "scans", format="osi")
    assert not (tmp_path / "scans").exists()

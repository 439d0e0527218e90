"""Exports in MCAP: readable by others, and the bits that trackers get."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from tests.support.exported import HIDDEN, SCENARIO

from trackbench.api.scenario import load, sense
from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.subjects.export.api import export

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


def test_the_truth_is_a_table(tmp_path: Path) -> None:
    export(SCENARIO, tmp_path / "scans", tmp_path / "truth", format="mcap")
    assert sorted(file.name for file in (tmp_path / "truth").iterdir()) == ["manifest.json", "truth.parquet"]


def test_reruns_own_reader_finds_nothing_wrong(tmp_path: Path) -> None:
    export(HIDDEN, tmp_path / "scans", format="mcap")
    place = "scans/scene0_run0.mcap"
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

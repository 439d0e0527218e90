"""The scans of a scenario as files: the same bits as trackers get, whole or not at all, and apart from the truth."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.support.exported import HIDDEN, SCENARIO

from trackbench.api.run import run
from trackbench.api.scenario import load, sense, truth
from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.subjects.export.api import export

COMPONENTS = {"radar": ["range_m", "azimuth_rad", "range_rate_mps"], "lidar": ["x_m", "y_m"]}


def read(folder: Path, name: str) -> pd.DataFrame:
    if (folder / f"{name}.parquet").exists():
        return pd.read_parquet(folder / f"{name}.parquet")
    return pd.read_csv(folder / f"{name}.csv")


def same_rows(rows: pd.DataFrame, scan: Scan, measurement: np.ndarray[Any, Any]) -> None:
    """That the rows of a scan say what a tracker gets, to the last bit."""
    first = rows.iloc[0]
    pose = [first[name] for name in ("sensor_x_m", "sensor_y_m", "sensor_yaw_rad", "sensor_vx_mps", "sensor_vy_mps")]
    assert pose == [*scan.sensor_pose, *scan.sensor_velocity]
    assert (first["sensor"], first["time_s"], first["arrival_time_s"]) == (scan.sensor, scan.time, scan.arrival_time)
    there = rows[rows["valid"] == 1]
    np.testing.assert_array_equal(there[COMPONENTS[scan.sensor]].to_numpy().T, measurement)
    others = {name for own in COMPONENTS.values() for name in own} - {*COMPONENTS[scan.sensor]}
    assert rows[[*others]].isna().to_numpy().all()


@functools.cache
def fingerprints_of(text: str) -> list[str]:
    """Those of the runs of a scenario."""
    return list(run(text).summary.fingerprints)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_the_tables_have_the_bits_that_trackers_get(tmp_path: Path, form: str) -> None:
    loaded = load(SCENARIO)
    export(loaded, tmp_path / "scans", format=form)
    rows = read(tmp_path / "scans", "scans")
    fingerprints = fingerprints_of(SCENARIO)
    for number in range(3):
        own = rows[rows["run"] == number]
        assert set(own["fingerprint"].astype(str)) == {fingerprints[number]}
        scans = sorted(sense(loaded, runs=range(number, number + 1)), key=lambda scan: (scan.arrival_time, scan.time))
        assert own["scan"].nunique() == len(scans)
        for (_, of_scan), scan in zip(own.groupby("scan"), scans, strict=True):
            assert of_scan["object"].tolist() == ["car", "cyclist"]
            assert of_scan["valid"].tolist() == scan.valid[:, 0].astype(int).tolist()
            same_rows(of_scan, scan, scan.measurement[:, scan.valid[:, 0], 0])


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_hidden_detections_are_those_that_trackers_get_and_empty_scans_are_rows(tmp_path: Path, form: str) -> None:
    loaded = load(HIDDEN)
    export(loaded, tmp_path / "scans", format=form)
    rows = read(tmp_path / "scans", "scans")
    assert "object" not in rows
    fingerprints, empty = fingerprints_of(HIDDEN), 0
    for number in range(3):
        own = rows[rows["run"] == number]
        assert set(own["fingerprint"].astype(str)) == {fingerprints[number]}
        scans = sorted(sense(loaded, runs=range(number, number + 1)), key=lambda scan: (scan.arrival_time, scan.time))
        for (_, of_scan), scan in zip(own.groupby("scan"), scans, strict=True):
            same_rows(of_scan, scan, scan.measurement)
            assert set(of_scan["detection_probability"]) == {scan.detection_probability}
            assert set(of_scan["clutter_density"]) == {scan.clutter_density}
            if scan.valid.size:
                assert of_scan["detection"].tolist() == [*range(scan.valid.size)]
            else:
                empty += 1
                assert of_scan["valid"].tolist() == [0]
                assert of_scan["detection"].isna().all()
    assert empty > 0


def test_the_truth_is_apart_and_as_it_is(tmp_path: Path) -> None:
    export(SCENARIO, tmp_path / "scans", tmp_path / "truth")
    rows, moved = read(tmp_path / "truth", "truth"), truth(load(SCENARIO))
    for number, name in enumerate(moved.ids):
        own = rows[rows["object"] == name]
        for column, values in (("x_m", moved.px), ("vy_mps", moved.vy), ("heading_rad", moved.heading)):
            np.testing.assert_array_equal(own[column], values[:, number, 0])
    assert rows["run"].isna().all()
    assert sorted(file.name for file in (tmp_path / "scans").iterdir()) == ["manifest.json", "scans.csv"]


def test_a_motion_drawn_anew_has_a_run_each(tmp_path: Path) -> None:
    text = SCENARIO.replace("pieces: [{for_s: 2}]", "pieces: [{for_s: 2, white_acceleration: {x_sigma_mps2: 1}}]")
    export(text, tmp_path / "scans", tmp_path / "truth")
    rows = read(tmp_path / "truth", "truth")
    assert sorted(rows["run"].unique()) == [0, 1, 2]
    assert rows[rows["time_s"] == 2].groupby("object")["x_m"].nunique()["cyclist"] == 3


def test_the_manifest_states_what_a_program_needs(tmp_path: Path) -> None:
    export(load(HIDDEN, {"monte_carlo.runs": 2}), tmp_path / "scans")
    manifest = json.loads((tmp_path / "scans" / "manifest.json").read_text())
    radar = manifest["sensors"]["radar"]
    scan = next(scan for scan in sense(HIDDEN) if scan.sensor == "radar")
    assert scan.field_of_view is not None
    np.testing.assert_array_equal(radar["noise_covariance"], scan.noise_covariance)
    assert radar["detection_probability"] == scan.detection_probability
    assert radar["clutter_density"] == scan.clutter_density
    assert radar["field_of_view"]["max_range_m"] == scan.field_of_view.max_range == 60
    assert radar["field_of_view"]["volume"] == scan.field_of_view.volume
    assert [part["column"] for part in radar["components"]] == COMPONENTS["radar"]
    assert (manifest["seed"], manifest["runs"], manifest["identities"]) == (7, 2, "hidden")
    assert manifest["scenario"]["sha256"] == hashlib.sha256(HIDDEN.encode()).hexdigest()
    assert [*manifest["columns"]] == (tmp_path / "scans" / "scans.csv").read_text().splitlines()[0].split(",")
    stated = {(entry["run"], entry["fingerprint"]) for entry in manifest["fingerprints"]}
    rows = read(tmp_path / "scans", "scans")
    assert stated == set(zip(rows["run"], rows["fingerprint"], strict=True))
    # What hidden identities hide is in no file of the folder.
    assert "cyclist" not in (tmp_path / "scans" / "manifest.json").read_text()


@pytest.mark.parametrize("place", ["scans/truth", "scans", "."])
def test_the_truth_is_never_beside_the_scans(tmp_path: Path, place: str) -> None:
    with pytest.raises(InputError, match="apart from the scans"):
        export(SCENARIO, tmp_path / "new" / "scans", tmp_path / "new" / place)
    assert not (tmp_path / "new" / "scans").exists()


def test_nothing_of_anyone_else_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not replaced"):
        export(SCENARIO, tmp_path / "scans")
    assert [file.name for file in tmp_path.rglob("*.*")] == ["notes.txt"]


def test_an_interrupted_export_leaves_the_earlier_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    export(SCENARIO, tmp_path / "scans")
    before = {file.name: file.read_bytes() for file in (tmp_path / "scans").iterdir()}
    monkeypatch.setattr("trackbench.subjects.export.api.scan_table", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export(SCENARIO, tmp_path / "scans")
    assert {file.name: file.read_bytes() for file in (tmp_path / "scans").iterdir()} == before
    assert [file.name for file in tmp_path.iterdir()] == ["scans"]


def test_the_command(tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "exported.yaml").write_text(SCENARIO)
    done = cli("export", "exported.yaml", "--scans", "scans", "--truth", "truth", "--runs", "1", "--seed", "3")
    assert done.status == 0, done.err
    assert done.out.splitlines() == ["scans/: scans.csv, manifest.json", "truth/: truth.csv, manifest.json"]
    manifest = json.loads((tmp_path / "scans" / "manifest.json").read_text())
    assert manifest["scenario"]["overrides"] == ["monte_carlo.runs=1", "monte_carlo.seed=3"]
    assert cli("export", "exported.yaml", "--scans", "scans", "--format", "parque").status == 2
    assert cli("export", "exported.yaml").status == 2
    assert cli("export", "nothing.yaml", "--scans", "scans").status == 2

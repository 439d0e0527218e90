"""The file of a recording: sound, whole or not there, with its scores, its text and its layout."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from rerun.chunk import RrdReader
from scipy import stats
from tests.support.recordings import shown_views

from trackbench.base.errors import InputError
from trackbench.results import Failure, Result
from trackbench.subjects.recording import writer as recording

Rewritten = Callable[..., Any]


def test_rerun_verifies_the_file(file: Path) -> None:
    command = [Path(sys.executable).parent / "rerun", "rrd", "verify", file]
    # With CI set, the command sends no usage data.
    done = subprocess.run(command, env=os.environ | {"CI": "1"}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 file verified without error" in done.stdout + done.stderr


def test_the_layout_is_in_the_file(file: Path, result: Result) -> None:
    assert len(RrdReader(file).blueprints()) == 1
    views = shown_views(file)
    assert {"Seen from above", *result.summary.truth.objects} <= views
    assert {"Legend", "Ranking", "About this run", "Position RMSE, m", "Velocity error, m/s", "NEES"} <= views


def test_series_hold_the_tables_values_and_share_their_bounds(read: Any, result: Result) -> None:
    steps = [row for row in result.tables.steps.to_pylist() if row["tracker"] == "ekf_cv"]
    rmse = read("/series/all_runs/position_rmse/ekf_cv", "Scalars:scalars")
    assert [rmse[round(row["time_s"], 9)] for row in steps] == [[row["position_rmse_m"]] for row in steps]
    bounds = [entity for entity in read.entities() if "/bounds/" in entity and entity.startswith("/series/all_runs/")]
    assert sorted(entity.removeprefix("/series/all_runs/").rpartition("/")[0] for entity in bounds) == sorted(
        (
            "position_rmse/bounds/position_reference_m",
            "velocity_rmse/bounds/velocity_reference_mps",
            "nees/bounds/nees_low",
            "nees/bounds/nees_high",
            *(f"nis/{sensor}/bounds/nis_{side}" for sensor in result.summary.sensors for side in ("low", "high")),
        )
    )


def test_the_recorded_run_has_the_rms_error_of_its_targets_and_bounds_for_their_number(
    read: Any, result: Result
) -> None:
    rows = [
        row
        for row in result.tables.estimates.to_pylist()
        if row["tracker"] == "ukf_ctrv" and round(row["time_s"], 9) == 8.0
    ]
    error = np.sqrt(np.mean([row["position_error_m"] ** 2 for row in rows]))
    assert read("/series/recorded_run/position_error/ukf_ctrv", "Scalars:scalars")[8.0] == pytest.approx([error])
    nees = np.mean([row["nees"] for row in rows])
    assert read("/series/recorded_run/nees/ukf_ctrv", "Scalars:scalars")[8.0] == pytest.approx([nees])
    high = stats.chi2.ppf(0.975, 4 * len(rows)) / len(rows)
    (bound,) = (entity for entity in read.entities() if entity.startswith("/series/recorded_run/nees/bounds/nees_high"))
    assert read(bound, "Scalars:scalars")[8.0] == pytest.approx([high])


def test_a_failed_tracker_is_named_with_its_cause(short: Result, rewritten: Rewritten) -> None:
    failed = Failure(cause="returned NaN", step=12, time_s=0.6, sensor="roof_lidar", run=3, object="v1")
    trackers = [
        tracker.model_copy(update={"failed": failed if tracker.name == "raw" else None})
        for tracker in short.summary.trackers
    ]
    others = {
        name: table.filter(pc.not_equal(table["tracker"], "raw"))
        for name, table in short.tables.items()
        if "tracker" in table.column_names
    }
    read = rewritten(short.updated(trackers=trackers), **others)
    assert "**raw**: returned NaN (step 12, 0.60 s" in read("/ranking", "TextDocument:text")[None][0]
    assert "/world/tracks/ekf_cv" in read.entities()
    assert "/world/tracks/raw" not in read.entities()


@pytest.mark.parametrize("name", ["roads", "measurements", "estimates", "recorded_nis", "nis"])
def test_an_empty_table_leaves_the_rest(name: str, short: Result, rewritten: Rewritten) -> None:
    assert "/world/vehicles/v1" in rewritten(**{name: short.tables[name].slice(0, 0)}).entities()


def test_a_run_in_which_every_tracker_failed_still_shows_the_scene(rewritten: Rewritten) -> None:
    nothing = dict.fromkeys(("steps", "nis", "estimates", "recorded_nis"), pa.table({}))
    entities = rewritten(**nothing).entities()
    assert {"/world/vehicles/v1", "/world/measurements/front_radar"} <= entities
    assert not any(entity.startswith("/series") for entity in entities)


def test_names_need_not_be_plain(short: Result, rewritten: Rewritten) -> None:
    measurements, sensors = short.tables.measurements, short.summary.sensors
    odd = pa.array([name.as_py().replace("front_radar", "front/radar é") for name in measurements["sensor"]])
    renamed = measurements.set_column(measurements.column_names.index("sensor"), "sensor", odd)
    result = short.updated(sensors=sensors | {"front/radar é": sensors["front_radar"]})
    entities = rewritten(result, measurements=renamed).entities()
    assert any(entity.startswith("/world/measurements/front\\/radar") for entity in entities)


def test_rerun_switched_off_by_the_environment_is_said(
    short: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(InputError, match="RERUN"):
        recording.write(short, tmp_path / "run.rrd")

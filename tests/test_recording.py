"""The recording of a run, read back from the file."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from rerun.chunk import RrdReader
from scipy import stats

from trackbench import recording
from trackbench.errors import InputError
from trackbench.palette import TRACKER_COLOURS, tracker_colour
from trackbench.recording.scene import ellipse
from trackbench.results import RunResult

STEPS, DT, RUNS = 401, 0.05, 100
TARGETS = ("v1", "v2", "v3", "v4", "v5")
TRACKERS = {"raw": 0.9, "kf_cv": 0.5, "ekf_cv": 0.42, "ukf_ctrv": 0.38, "tuned_badly": 0.55}
CLAIMED = 0.4
SENSORS = {"front_radar": (1, 3), "roof_lidar": (2, 2)}
TIME = np.arange(STEPS) * DT


def synthetic_result() -> RunResult:
    """Traffic on three lanes: v1 changes lane to the left, v4 arrives at 5 s, v5 leaves at 12 s."""
    rng = np.random.default_rng(5)
    truth = _truth()
    estimates, shown_nis, steps, nis = [], [], [], []
    for tracker, sigma in TRACKERS.items():
        for name in TARGETS:
            estimates.append(_estimates(rng, tracker, sigma, truth[name]))
        growth = 1 + 2 * np.exp(-TIME)
        rmse = sigma * growth * (1 + 0.03 * rng.standard_normal(STEPS))
        count = RUNS * sum(truth[name]["alive"] for name in TARGETS)
        low, high = (stats.chi2.ppf(q, 4 * count) / count for q in (0.025, 0.975))
        mean = rng.chisquare(4 * count) / count * (3.0 if tracker == "tuned_badly" else 1.0)
        steps.append(
            {
                "tracker": [tracker] * STEPS,
                "time_s": TIME,
                "count": count,
                "position_rmse_m": rmse,
                "velocity_rmse_mps": 2 * rmse,
                "nees_mean": mean,
                "nees_low": low,
                "nees_high": high,
                "position_bound_m": 0.3 * growth,
                "velocity_bound_mps": 0.5 * growth,
            }
        )
        for sensor, (every, dof) in SENSORS.items():
            if tracker == "raw":
                continue
            at, number = TIME[::every], count[::every]
            low, high = (stats.chi2.ppf(q, dof * number) / number for q in (0.025, 0.975))
            mean = rng.chisquare(dof * number) / number * (1.6 if tracker == "tuned_badly" else 1.0)
            nis.append(
                {
                    "tracker": [tracker] * len(at),
                    "sensor": [sensor] * len(at),
                    "time_s": at,
                    "nis_mean": mean,
                    "dof": np.full(len(at), float(dof)),
                    "nis_low": low,
                    "nis_high": high,
                }
            )
            for name in TARGETS:
                seen = at[truth[name]["alive"][::every]]
                shown_nis.append(
                    {
                        "tracker": [tracker] * len(seen),
                        "sensor": [sensor] * len(seen),
                        "object": [name] * len(seen),
                        "time_s": seen,
                        "nis": rng.chisquare(dof, len(seen)),
                    }
                )
    lanes = [(line, x, 4.0 * line - 2.0) for line in range(4) for x in np.linspace(-50, 650, 71)]
    tables = {
        "truth": [{**rows, "heading_rad": rows["course_rad"]} for rows in truth.values()],
        "readings": [_readings(rng, truth, name, sensor) for sensor in SENSORS for name in TARGETS],
        "estimates": estimates,
        "shown_nis": shown_nis,
        "steps": steps,
        "nis": nis,
        "roads": [dict(zip(("line", "x_m", "y_m"), map(np.array, zip(*lanes, strict=True)), strict=True))],
    }
    return RunResult(_summary(), {name: _table(parts) for name, parts in tables.items()})


def _truth() -> dict[str, dict[str, Any]]:
    starts = {"ego": (0, 4, 25), "v1": (15, 0, 25.5), "v2": (-14, 8, 25.5), "v3": (34, 4, 25), "v4": (20, 8, 25)}
    starts["v5"] = (-20, 0, 24.5)
    lives = {"v4": TIME >= 5, "v5": TIME < 12}
    rows = {}
    for name, (x, y, speed) in starts.items():
        change = 2 * (1 + np.tanh((TIME - 8) / 1.2)) if name == "v1" else np.zeros(STEPS)
        vy = np.gradient(change, DT)
        rows[name] = {
            "object": [name] * STEPS,
            "role": ["observer" if name == "ego" else "target"] * STEPS,
            "time_s": TIME,
            "alive": lives.get(name, np.ones(STEPS, dtype=bool)),
            "px_m": x + speed * TIME,
            "py_m": y + change,
            "course_rad": np.arctan2(vy, speed),
            "length_m": np.full(STEPS, 5.0),
            "width_m": np.full(STEPS, 2.0),
        }
    return rows


def _estimates(rng: np.random.Generator, tracker: str, sigma: float, truth: dict[str, Any]) -> dict[str, Any]:
    smooth = np.exp(-np.arange(20) / 6.0)
    noise = rng.standard_normal((2, STEPS + 40))
    error = np.stack([np.convolve(row, smooth / np.linalg.norm(smooth), "same")[20:-20] for row in noise])
    error *= sigma / np.sqrt(2) * (1 + 2 * np.exp(-TIME))
    alive = truth["alive"]
    number = int(alive.sum())
    p_00, p_11, p_01 = 1.6 * CLAIMED**2, 0.4 * CLAIMED**2, 0.6 * CLAIMED**2
    inverse = np.linalg.inv([[p_00, p_01], [p_01, p_11]])
    return {
        "tracker": [tracker] * number,
        "object": list(np.array(truth["object"])[alive]),
        "time_s": TIME[alive],
        "px_m": (truth["px_m"] + error[0])[alive],
        "py_m": (truth["py_m"] + error[1])[alive],
        "p_00": np.full(number, p_00),
        "p_01": np.full(number, p_01),
        "p_11": np.full(number, p_11),
        "position_error_m": np.hypot(*error)[alive],
        "nees": np.einsum("it,ij,jt->t", error, inverse, error)[alive] + rng.chisquare(2, number),
    }


def _readings(rng: np.random.Generator, truth: dict[str, dict[str, Any]], name: str, sensor: str) -> dict[str, Any]:
    every, _ = SENSORS[sensor]
    rows = {key: np.asarray(values)[::every] for key, values in truth[name].items()}
    number = len(rows["time_s"])
    valid = rows["alive"] & (rng.random(number) < 0.9)
    x, y = (np.where(valid, rows[axis] + 0.4 * rng.standard_normal(number), np.nan) for axis in ("px_m", "py_m"))
    return {"sensor": [sensor] * number, "object": [name] * number, "time_s": rows["time_s"], "valid": valid} | {
        "x_m": x,
        "y_m": y,
    }


def _table(parts: list[dict[str, Any]]) -> pa.Table:
    return pa.table({key: np.concatenate([np.asarray(part[key]) for part in parts]) for key in parts[0]})


def _summary() -> dict[str, Any]:
    trackers = []
    for name, sigma in TRACKERS.items():
        bad = name == "tuned_badly"
        nees = {"mean": 12.1 if bad else 4.02, "verdict": "optimistic" if bad else "consistent"}
        metrics = {
            "position_rmse": {"value": sigma, "unit": "m", "ci95": [sigma - 0.01, sigma + 0.01]},
            "nees": {"mean": None, "reason": "no covariance"} if name == "raw" else nees,
            "position_efficiency": {"value": sigma / 0.3, "unit": "1"},
        }
        trackers.append({"name": name, "describe": f"{name}, both sensors", "failed": None, "metrics": metrics})
    sensors = {
        "front_radar": {"kind": "radar", "dof": 3, "rate_hz": 20, "detection_rate": 0.9, "preset": None},
        "roof_lidar": {"kind": "lidar", "dof": 2, "rate_hz": 10, "detection_rate": 0.9, "preset": None},
    }
    return {
        "scenario": {"name": "synthetic_highway", "description": "Six cars on three lanes; one changes lane."},
        "seed": 7,
        "runs": RUNS,
        "versions": {"trackbench": "0.1.0", "numpy": "2.4.0"},
        "command": "trackbench run synthetic.yaml",
        "fingerprint": "0123456789abcdef" * 4,
        "truth": {"source": "highway-env", "env": "highway-v0", "objects": list(TARGETS), "duration_s": 20.0},
        "sensors": sensors,
        "shown_run": 0,
        "trackers": trackers,
        "ranking": sorted(TRACKERS, key=TRACKERS.__getitem__),
        "expectations": [
            {"text": "ukf_ctrv position_rmse below 0.45", "value": 0.38, "passed": True},
            {"text": "tuned_badly nees.verdict is consistent", "value": "optimistic", "passed": False},
        ],
        "passed": False,
    }


@pytest.fixture(scope="module")
def result() -> RunResult:
    return synthetic_result()


@pytest.fixture(scope="module")
def file(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    recording.write(result, path)
    return path


class Read:
    """The rows of a recording: for an entity and a component, values by time in seconds (None: static)."""

    def __init__(self, path: Path) -> None:
        self.rows: dict[tuple[str, str], dict[float | None, Any]] = {}
        self.timelines: set[str] = set()
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            self.timelines.update(chunk.timeline_names)
            times = [None] * len(batch) if chunk.is_static else batch.column("sim_time").to_numpy().astype(float) / 1e9
            for name in batch.schema.names:
                values = batch.column(name).to_pylist()
                self.rows.setdefault((chunk.entity_path, name), {}).update(zip(times, values, strict=True))

    def __call__(self, entity: str, component: str) -> dict[float | None, Any]:
        return self.rows[entity, component]

    def entities(self) -> set[str]:
        return {entity for entity, _ in self.rows}


@pytest.fixture(scope="module")
def read(file: Path) -> Read:
    return Read(file)


def test_rerun_verifies_the_file(file: Path) -> None:
    command = [Path(sys.executable).parent / "rerun", "rrd", "verify", file]
    # With CI set, the command sends no usage data.
    done = subprocess.run(command, env=os.environ | {"CI": "1"}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 file verified without error" in done.stdout + done.stderr


def test_five_vehicles_and_five_trackers_in_a_second_and_ten_megabytes(result: RunResult, tmp_path: Path) -> None:
    start = time.perf_counter()
    recording.write(result, tmp_path / "run.rrd")
    assert time.perf_counter() - start < 1.0
    assert (tmp_path / "run.rrd").stat().st_size < 10e6


def test_the_layout_is_in_the_file(file: Path) -> None:
    reader = RrdReader(file)
    assert len(reader.blueprints()) == 1
    (store,) = reader.blueprints()
    views = {
        row[0]
        for chunk in reader.stream(store=store)
        if "ViewBlueprint:display_name" in (batch := chunk.to_record_batch()).schema.names
        for row in batch.column("ViewBlueprint:display_name").to_pylist()
    }
    assert {"Seen from above", *TARGETS, "Ranking", "About this run", "Position RMSE, 100 runs, m"} <= views


def test_there_is_one_timeline_in_simulated_seconds(read: Read) -> None:
    assert read.timelines == {"sim_time"}
    (boxes,) = (set(read("/world/vehicles/v1", "Boxes2D:half_sizes")) - {None},)
    assert boxes == {round(t, 9) for t in TIME}


def test_each_vehicle_is_an_oriented_box_at_every_step_of_its_life(read: Read, result: RunResult) -> None:
    truth = result.tables["truth"].to_pylist()
    for name in ("ego", *TARGETS):
        rows = [row for row in truth if row["object"] == name]
        boxes = read(f"/world/vehicles/{name}", "Boxes2D:half_sizes")
        assert len(boxes) == STEPS
        assert [len(boxes[round(row["time_s"], 9)]) for row in rows] == [int(row["alive"]) for row in rows]
    row = next(row for row in truth if row["object"] == "v1" and row["time_s"] == TIME[160])
    assert read("/world/vehicles/v1", "Boxes2D:half_sizes")[8.0] == [[2.5, 1.0]]
    assert read("/world/vehicles/v1", "Transform3D:translation")[8.0][0] == pytest.approx([row["px_m"], row["py_m"], 0])
    (quaternion,) = read("/world/vehicles/v1", "Transform3D:quaternion")[8.0]
    assert 2 * np.arctan2(quaternion[2], quaternion[3]) == pytest.approx(row["heading_rad"], abs=1e-6)


def test_a_view_follows_the_observer_and_is_not_mirrored(read: Read, result: RunResult) -> None:
    v1 = next(row for row in result.tables["truth"].to_pylist() if row["object"] == "v1" and row["time_s"] == TIME[160])
    (origin,) = read("/world/frames/ego", "Transform3D:translation")[8.0]
    (flat,) = read("/world/frames/ego", "Transform3D:mat3x3")[8.0]
    to_view = np.linalg.inv(np.array(flat).reshape(3, 3, order="F"))
    seen = to_view @ (np.array([v1["px_m"], v1["py_m"] + 1.0, 0.0]) - origin)
    assert seen[0] > 0, "what is ahead of the observer is on the right"
    assert seen[1] == pytest.approx(-(v1["py_m"] + 1.0 - 4.0), abs=1e-4), "y of a 2D view points down"


def test_readings_are_where_the_sensor_put_them_and_misses_are_not_drawn(read: Read, result: RunResult) -> None:
    for sensor in SENSORS:
        rows = [row for row in result.tables["readings"].to_pylist() if row["sensor"] == sensor]
        drawn = {t: points for t, points in read(f"/world/readings/{sensor}", "Points2D:positions").items() if t}
        assert sum(map(len, drawn.values())) == sum(row["valid"] for row in rows if row["time_s"])
        at_8 = [[row["x_m"], row["y_m"]] for row in rows if row["valid"] and round(row["time_s"], 9) == 8.0]
        np.testing.assert_allclose(sorted(drawn[8.0]), sorted(at_8), rtol=1e-6)


def test_an_ellipse_encloses_95_percent() -> None:
    covariance = np.array([[2.0, 0.9], [0.9, 1.0]])
    (half,), (angle,) = ellipse(*(np.array([covariance[i]]) for i in ((0, 0), (0, 1), (1, 1))))
    rng = np.random.default_rng(0)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    x, y = turn @ np.linalg.cholesky(covariance) @ rng.standard_normal((2, 200_000))
    assert np.mean((x / half[0]) ** 2 + (y / half[1]) ** 2 < 1) == pytest.approx(0.95, abs=0.002)
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(0, abs=0.01)


def test_a_known_covariance_is_drawn_with_its_axes_and_rotation(read: Read, result: RunResult) -> None:
    row = next(
        row
        for row in result.tables["estimates"].to_pylist()
        if (row["tracker"], row["object"], row["time_s"]) == ("ekf_cv", "v1", TIME[160])
    )
    variances, axes = np.linalg.eigh([[row["p_00"], row["p_01"]], [row["p_01"], row["p_11"]]])
    entity = "/world/estimates/ekf_cv/v1"
    assert read(entity, "Points2D:positions")[8.0][0] == pytest.approx([row["px_m"], row["py_m"]])
    (half,) = read(f"{entity}/covariance", "Ellipses2D:half_sizes")[8.0]
    assert half == pytest.approx(2.4477 * np.sqrt(variances[::-1]), rel=1e-4)
    (quaternion,) = read(f"{entity}/covariance", "Transform3D:quaternion")[8.0]
    angle = 2 * np.arctan2(quaternion[2], quaternion[3])
    assert abs(axes[:, 1] @ [np.cos(angle), np.sin(angle)]) == pytest.approx(1.0, abs=1e-6)


def test_an_estimate_disappears_with_its_vehicle(read: Read) -> None:
    for component, entity in (("Points2D:positions", ""), ("Ellipses2D:half_sizes", "/covariance")):
        drawn = read(f"/world/estimates/ekf_cv/v5{entity}", component)
        assert (len(drawn[11.95]), len(drawn[12.0])) == (1, 0)
        assert max(t for t in drawn if t is not None) == 12.0


def test_an_estimate_that_is_not_renewed_disappears(result: RunResult, tmp_path: Path) -> None:
    estimates = result.tables["estimates"]
    stopped = estimates.filter(pc.less(estimates["time_s"], 3.01))
    recording.write(RunResult(result.summary, result.tables | {"estimates": stopped}), tmp_path / "run.rrd")
    drawn = Read(tmp_path / "run.rrd")("/world/estimates/ekf_cv/v1", "Points2D:positions")
    assert (len(drawn[3.0]), len(drawn[3.1])) == (1, 0), "held for a period of the slowest sensor, 0.1 s"


def test_series_hold_the_tables_values_and_share_their_bounds(read: Read, result: RunResult) -> None:
    steps = [row for row in result.tables["steps"].to_pylist() if row["tracker"] == "ekf_cv"]
    rmse = read("/series/all_runs/position_rmse/ekf_cv", "Scalars:scalars")
    assert [rmse[round(row["time_s"], 9)] for row in steps] == [[row["position_rmse_m"]] for row in steps]
    bounds = {entity for entity in read.entities() if "/bounds/" in entity and "/all_runs/" in entity}
    assert {entity.removeprefix("/series/all_runs/") for entity in bounds} == {
        "position_rmse/bounds/position_bound_m_1",
        "velocity_rmse/bounds/velocity_bound_mps_1",
        "nees/bounds/nees_low_1",
        "nees/bounds/nees_high_1",
        *(f"nis/{sensor}/bounds/nis_{side}_1" for sensor in SENSORS for side in ("low", "high")),
    }


def test_the_shown_run_has_the_rms_error_of_its_targets_and_bounds_for_their_number(
    read: Read, result: RunResult
) -> None:
    rows = [
        row
        for row in result.tables["estimates"].to_pylist()
        if row["tracker"] == "ukf_ctrv" and row["time_s"] == TIME[160]
    ]
    error = np.sqrt(np.mean([row["position_error_m"] ** 2 for row in rows]))
    assert read("/series/shown_run/position_error/ukf_ctrv", "Scalars:scalars")[8.0] == pytest.approx([error])
    nees = np.mean([row["nees"] for row in rows])
    assert read("/series/shown_run/nees/ukf_ctrv", "Scalars:scalars")[8.0] == pytest.approx([nees])
    high = stats.chi2.ppf(0.975, 4 * len(rows)) / len(rows)
    assert read("/series/shown_run/nees/bounds/high_1", "Scalars:scalars")[8.0] == pytest.approx([high])


def test_a_line_is_broken_where_there_is_no_value(result: RunResult, tmp_path: Path) -> None:
    steps = result.tables["steps"]
    column = steps.column_names.index("nees_mean")
    values = steps["nees_mean"].to_numpy().copy()
    values[10] = np.nan
    recording.write(
        RunResult(result.summary, result.tables | {"steps": steps.set_column(column, "nees_mean", pa.array(values))}),
        tmp_path / "run.rrd",
    )
    nees = Read(tmp_path / "run.rrd")("/series/all_runs/nees/raw", "Scalars:scalars")
    assert (nees[0.5], len(nees[0.55])) == ([], 1)


def test_a_tracker_has_one_colour_in_the_scene_and_in_the_plots(read: Read) -> None:
    for name, colour in tracker_colour(TRACKERS).items():
        expected = [int(colour[1:] + "FF", 16)]
        assert read(f"/world/estimates/{name}/v1", "Points2D:colors")[None] == expected
        assert read(f"/world/estimates/{name}/v1/covariance", "Ellipses2D:colors")[None] == expected
        assert read(f"/series/all_runs/nees/{name}", "SeriesLines:colors")[None] == expected
    assert len(set(TRACKER_COLOURS)) == len(TRACKER_COLOURS)


def test_the_text_ranks_the_trackers_and_names_the_run(read: Read) -> None:
    (ranking,) = read("/ranking", "TextDocument:text")[None]
    lines = [line for line in ranking.splitlines() if line.startswith("| ")]
    assert [line.split(" | ")[1] for line in lines[1:]] == sorted(TRACKERS, key=TRACKERS.__getitem__)
    assert "| 4 | tuned_badly | 0.550 | 0.540 to 0.560 | 1.83 | 12.1 | optimistic |" in lines
    assert "- **not met**: tuned_badly nees.verdict is consistent (is optimistic)" in ranking
    (about,) = read("/about", "TextDocument:text")[None]
    assert "run 0 of 100, seed 7" in about
    assert read("/__properties/trackbench", "seed")[None] == [7]
    assert read("/__properties/trackbench", "scenario")[None] == ["synthetic_highway"]


def test_a_failed_tracker_is_named_with_its_cause(result: RunResult, tmp_path: Path) -> None:
    failed = {"cause": "returned NaN", "step": 12, "time_s": 0.6, "sensor": "roof_lidar", "run": 3, "object": "v1"}
    trackers = [entry | {"failed": failed if entry["name"] == "raw" else None} for entry in result.summary["trackers"]]
    others = {
        name: table.filter(pc.not_equal(table["tracker"], "raw")) if "tracker" in table.column_names else table
        for name, table in result.tables.items()
    }
    recording.write(RunResult(result.summary | {"trackers": trackers}, others), tmp_path / "run.rrd")
    read = Read(tmp_path / "run.rrd")
    assert "**raw** at 0.600 s (step 12, run 3): returned NaN" in read("/ranking", "TextDocument:text")[None][0]
    assert "/world/estimates/ekf_cv/v1" in read.entities()
    assert "/world/estimates/raw/v1" not in read.entities()


@pytest.mark.parametrize("name", ["roads", "readings", "estimates", "shown_nis", "nis"])
def test_an_empty_table_leaves_the_rest(name: str, result: RunResult, tmp_path: Path) -> None:
    recording.write(
        RunResult(result.summary, result.tables | {name: result.tables[name].slice(0, 0)}), tmp_path / "a.rrd"
    )
    assert "/world/vehicles/v1" in Read(tmp_path / "a.rrd").entities()


def test_names_need_not_be_plain(result: RunResult, tmp_path: Path) -> None:
    readings = result.tables["readings"]
    odd = pa.array([name.as_py().replace("front_radar", "front/radar é") for name in readings["sensor"]])
    tables = result.tables | {"readings": readings.set_column(readings.column_names.index("sensor"), "sensor", odd)}
    sensors = result.summary["sensors"]
    summary = result.summary | {"sensors": sensors | {"front/radar é": sensors["front_radar"]}}
    recording.write(RunResult(summary, tables), tmp_path / "run.rrd")
    assert any(entity.startswith("/world/readings/front\\/radar") for entity in Read(tmp_path / "run.rrd").entities())


def test_an_existing_recording_is_replaced_whole_and_nothing_else_is_left(result: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"old")
    recording.write(result, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
    assert len(RrdReader(path).recordings()) == 1


def test_a_folder_that_cannot_be_written_is_one_clear_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere/run\.rrd: the recording cannot be written: No such file"):
        recording.write(result, tmp_path / "nowhere" / "run.rrd")
    (tmp_path / "run.rrd").mkdir()
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        recording.write(result, tmp_path / "run.rrd")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]


def test_a_full_disk_leaves_the_old_recording(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> int:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "run.rrd").write_text("old")
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="No space left on device"):
        recording.write(result, tmp_path / "run.rrd")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
    assert (tmp_path / "run.rrd").read_text() == "old"


def test_rerun_switched_off_by_the_environment_is_said(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(InputError, match="RERUN"):
        recording.write(result, tmp_path / "run.rrd")

"""Several logs of one recording: each is a scene."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.support.udacity import synthetic_lines

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.truth.config.logs import log_names

SENSORS = {
    "roof": {"type": "lidar", "position_sigma_m": 0.15},
    "front": {"type": "radar", "range_sigma_m": 0.3, "azimuth_sigma_deg": 1.7, "range_rate_sigma_mps": 0.3},
}
EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}


def scenario(folder: Path, truth: dict, sensors: dict = SENSORS) -> Path:
    content = {
        "name": "logs",
        "truth": {"source": "recording", **truth},
        "sensors": sensors,
        "trackers": {"ekf": EKF},
        "monte_carlo": {"runs": 1},
    }
    file = folder / "logs.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def udacity(folder: Path, name: str, count: int, seed: int) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text("\n".join(synthetic_lines(count, seed)))


def tables(folder: Path, name: str, rows: int) -> None:
    """A car that drives past, and a lidar of its own file."""
    for part in ("truth", "lidar"):
        (folder / part).mkdir(exist_ok=True)
    times = [0.1 * k for k in range(rows)]
    truth = "".join(f"{t},{10 + 5 * t},{t},5,1\n" for t in times)
    (folder / "truth" / f"{name}.csv").write_text("t,x,y,vx,vy\n" + truth)
    seen = "".join(f"{t},{10 + 5 * t + 0.1 * (-1) ** k},{t}\n" for k, t in enumerate(times))
    (folder / "lidar" / f"{name}.csv").write_text("t,x,y\n" + seen)


TABLES = {
    "format": "csv",
    "path": ["truth/monday.csv", "truth/tuesday.csv"],
    "columns": {"time": "t", "px": "x", "py": "y", "vx": "vx", "vy": "vy"},
    "readings": {"roof": {"path": ["lidar/monday.csv", "lidar/tuesday.csv"], "x": "x", "y": "y"}},
}
LIDAR = {"roof": SENSORS["roof"]}


def test_files_of_a_list_are_scenes_that_give_what_each_gives_alone(tmp_path: Path) -> None:
    for name, count, seed in (("a.txt", 120, 1), ("b.txt", 200, 2)):
        udacity(tmp_path / "logs", name, count, seed)
    both = tb.run(scenario(tmp_path, {"format": "udacity", "path": ["logs/a.txt", "logs/b.txt"]}))
    assert [scene.name for scene in both.summary.truth.scenes] == ["a", "b"]
    assert both.summary.runs == 2
    alone = [tb.run(scenario(tmp_path, {"format": "udacity", "path": f"logs/{name}.txt"})) for name in ("a", "b")]
    errors = [scene.error["ekf"] for scene in both.summary.truth.scenes]
    assert errors == pytest.approx([result["ekf"].position_rmse.value for result in alone], rel=1e-9)
    assert both.summary.fingerprints == [result.summary.fingerprints[0] for result in alone]


def test_tables_of_several_logs_go_together_by_their_place(tmp_path: Path) -> None:
    for name, rows in (("monday", 40), ("tuesday", 60)):
        tables(tmp_path, name, rows)
    both = tb.run(scenario(tmp_path, TABLES, LIDAR))
    scenes = both.summary.truth.scenes
    assert [(scene.name, round(scene.duration_s, 6)) for scene in scenes] == [("monday", 3.9), ("tuesday", 5.9)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": ["truth/monday.csv", "truth/friday.csv"]}, "truth.path: scene 2 of 2: there is no file"),
        ({"path": ["truth/monday.csv", "truth/monday.csv"]}, "truth.path: truth/monday.csv is there already"),
        (
            {"readings": {"roof": {"path": "lidar/monday.csv", "x": "x", "y": "y"}}},
            "truth.readings.roof.path: 1 file, where there must be one for each of 2 logs",
        ),
        (
            {"path": "..", "readings": {}, "columns": None, "format": "udacity"},
            "truth.path: .. is a folder; name a file",
        ),
        ({"path": 3}, "truth.path: write a file, or a list of files"),
    ],
)
def test_files_that_do_not_go_together_are_refused(tmp_path: Path, change: dict, message: str) -> None:
    for name in ("monday", "tuesday"):
        tables(tmp_path, name, 40)
    truth = {key: value for key, value in {**TABLES, **change}.items() if value}
    with pytest.raises(InputError) as error:
        tb.run(scenario(tmp_path, truth, LIDAR))
    assert message in str(error.value)
    assert "logs.yaml" in str(error.value)


def test_logs_without_a_truth_are_scenes_too(tmp_path: Path) -> None:
    for name in ("monday", "tuesday"):
        tables(tmp_path, name, 40)
    truth = {"format": "csv", "readings": {"roof": {**TABLES["readings"]["roof"], "time": "t"}}}
    file = scenario(tmp_path, truth, {"roof": {**SENSORS["roof"], "max_range_m": 100}})
    content = yaml.safe_load(file.read_text())
    content["sensing"] = {"identities": "hidden"}
    content["trackers"] = {"gnn": {**EKF, "associate": {"method": "gnn"}}}
    file.write_text(yaml.safe_dump(content))
    assert tb.run(file).summary.runs == 2


def test_logs_are_named_by_what_tells_them_apart() -> None:
    assert log_names(["logs/a.csv", "logs/b.csv"]) == ["a", "b"]
    assert log_names(["monday/truth.csv", "tuesday/truth.csv"]) == ["monday", "tuesday"]
    assert log_names(["x/truth.csv", "x/x/truth.csv"]) == ["x/truth.csv", "x/x/truth.csv"]

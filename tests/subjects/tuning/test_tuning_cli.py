"""``trackbench tune``, as its user meets it."""

from __future__ import annotations

import json
import shutil
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.places import DOCS

from trackbench.scenario import load_scenario

Cli = Callable[..., Any]

SCENARIO = """# One car, driven by the filter's own model.
name: own
truth:
  source: scripted
  duration_s: 5
  rate_hz: 10
  objects:
    car:
      start: {x: 60, y: 0, speed_mps: 5, course_deg: 90}
      pieces: [{white: {motion: cv, acceleration_sigma_mps2: 2}}]
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}
trackers:
  kf: {filter: kf, motion: cv, acceleration_sigma_mps2: 20}   # far too large
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 2}
  raw: {use: raw}
monte_carlo: {runs: 40, seed: 7}
"""
HIDDEN = """name: hidden
truth:
  source: scripted
  duration_s: 3
  rate_hz: 10
  objects: {car: {start: {x: 40, vx_mps: 5}}, other: {start: {x: 30, y: 20, vx_mps: 8}}}
sensing: {identities: hidden}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, max_range_m: 100, clutter: {per_scan: 5}}
trackers:
  gnn: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}
monte_carlo: {runs: 2, seed: 7}
"""


@pytest.fixture(autouse=True)
def own(tmp_path: Path) -> Path:
    file = tmp_path / "own.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


def test_a_tracker_is_tuned_on_some_noise_and_tried_on_other(cli: Cli, tmp_path: Path) -> None:
    done = cli("tune", "own.yaml", "--trackers", "kf", "--trials", "16", "--out", "out/tuned.yaml")
    assert done.status == 0, done.err
    assert "better than the start" in " ".join(done.out.split())
    tuned = load_scenario(tmp_path / "out" / "tuned.yaml")
    assert tuned.config.trackers["kf"].motion.acceleration_sigma_mps2 == pytest.approx(2, rel=0.2)  # type: ignore[union-attr]
    assert tuned.config.trackers["kf_start"].motion.acceleration_sigma_mps2 == 20  # type: ignore[union-attr]
    found = json.loads((tmp_path / "out" / "tuned.json").read_text(encoding="utf-8"))
    (tracker,) = found["trackers"]
    assert [len(tracker["trials"]), tracker["start"]] == [16, {"acceleration_sigma_mps2": 20}]
    verdicts = {item["metric"]: item["verdict"] for item in tracker["held_out"]}
    assert verdicts == {
        "position_rmse": "better",
        "velocity_rmse": "better",
        "nees": "larger",
        "log_likelihood": "better",
    }
    assert found["command"].startswith("trackbench tune own.yaml --trackers kf --objective likelihood --trials 16")
    assert "The trials over acceleration_sigma_mps2" in (tmp_path / "out" / "tuned.html").read_text(encoding="utf-8")
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"tuned.yaml", "tuned.json", "tuned.html"}
    assert cli("check", "out/tuned.yaml").status == 0


def test_the_only_tracker_with_options_is_tuned_into_a_folder(cli: Cli, tmp_path: Path) -> None:
    text = (tmp_path / "own.yaml").read_text(encoding="utf-8")
    only = yaml.safe_load(text)
    only["trackers"] = {"raw": {"use": "raw"}, "kf": only["trackers"]["kf"]}
    only.pop("expect", None)
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(only), encoding="utf-8")
    done = cli("tune", "one.yaml", "--trials", "8", "--out", "folder")
    assert done.status == 0, done.err
    assert done.out.startswith("Tuning of kf: position RMSE ")
    assert (tmp_path / "folder" / "tuned.yaml").is_file()


def test_a_gain_that_is_noise_is_said_to_be(cli: Cli) -> None:
    near = ("--set", "trackers.ekf.acceleration_sigma_mps2=2.2")
    done = cli("tune", "own.yaml", "--trackers", "ekf", "--trials", "16", "--seed", "3", "--json", *near)
    (tracker,) = json.loads(done.out)["trackers"]
    assert "may be noise" in tracker["verdict"]


def test_an_optimum_at_the_edge_is_said_to_be(cli: Cli) -> None:
    done = cli("tune", "own.yaml", "--trackers", "kf", "--range", "acceleration_sigma_mps2=10:30", "--trials", "12")
    assert "the optimum is at the edge of the range, 10 is the smallest that was tried" in " ".join(done.out.split())


def test_gate_and_confirmation_are_tuned_for_tgospa(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "hidden.yaml").write_text(HIDDEN, encoding="utf-8")
    done = cli("tune", "hidden.yaml", "--trackers", "gnn", "--trials", "4", "--range", "associate.gate=0.9:0.9999",
               "--range", "associate.confirm=[1,1],[3,5]", "--json")  # fmt: skip
    (tracker,) = json.loads(done.out)["trackers"]
    assert set(tracker["tuned"]) == {"associate.gate", "associate.confirm"}
    assert {item["metric"] for item in tracker["held_out"]} >= {"tgospa", "gospa", "gospa_false", "gospa_missed"}


def test_several_scenarios_get_one_set_of_values(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text(SCENARIO.replace("name: own", "name: two"), encoding="utf-8")
    done = cli("tune", "own.yaml", "two.yaml", "--trackers", "kf", "--trials", "8", "--out", "family")
    assert done.status == 0, done.err
    names = ("own", "two")
    tuned = [load_scenario(tmp_path / "family" / f"{name}.yaml").config.trackers["kf"] for name in names]
    assert tuned[0] == tuned[1]
    assert (tmp_path / "family" / "tuning.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--trackers", "ekv"), "did you mean 'ekf'"),
        (("--trackers", "kf", "--objective", "tgospa"), "no objective 'tgospa' in own"),
        (("--trackers", "kf", "--objective", "position_rms"), "did you mean 'position_rmse'"),
        (("--trackers", "kf", "--train-scenes", "3"), "own has one scene"),
        (("--trackers", "kf", "--out", "own.yaml"), "not overwritten"),
        (("--trackers", "kf", "--out", "folder.json"), ".yaml"),
        ((), "name the trackers to tune; choose from: "),
    ],
)
def test_bad_input_is_one_message(cli: Cli, arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    before = set(tmp_path.iterdir())
    done = cli("tune", "own.yaml", *arguments)
    assert done.status == 2
    assert message in done.err
    assert "Traceback" not in done.err
    assert set(tmp_path.iterdir()) == before


def test_a_tracker_without_innovations_has_no_likelihood(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(DOCS / "examples" / "alpha_beta.py", tmp_path)
    text = SCENARIO.replace("{use: raw}", "{use: 'alpha_beta:AlphaBeta', options: {alpha: 0.3}}")
    (tmp_path / "own.yaml").write_text(text, encoding="utf-8")
    alpha = ("--trackers", "raw", "--range", "options.alpha=0.1:0.9", "--in-process", "--train-runs", "2")
    done = cli("tune", "own.yaml", *alpha)
    assert done.status == 2
    assert "gives no innovations" in done.err
    done = cli("tune", "own.yaml", *alpha, "--objective", "position_rmse", "--trials", "4", "--test-runs", "4")
    assert done.status == 0, done.err
    assert "alpha_beta.py" not in done.out  # It is beside the new scenario already.


def test_without_optuna_one_line_names_the_extra(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    done = cli("tune", "own.yaml", "--trackers", "kf")
    assert done.status == 2
    assert done.err.strip() == "tuning needs Optuna: pip install 'trackbench[tune]'"


def trials(file: Path) -> int:
    """How many there are in the study."""
    if not file.is_file():
        return 0
    with closing(sqlite3.connect(file)) as connection:
        try:
            return int(connection.execute("select count(*) from trials").fetchone()[0])
        except sqlite3.OperationalError:
            return 0


@pytest.mark.slow
def test_on_truth_of_its_own_model_the_true_sigmas_are_found(cli: Cli, tmp_path: Path) -> None:
    # 100 runs of 400 steps; the likelihood knows the sigmas to 1 %.
    model = "{motion: ctrv, acceleration_sigma_mps2: 1, yaw_acceleration_sigma_radps2: 0.3}"
    text = SCENARIO.replace("{motion: cv, acceleration_sigma_mps2: 2}", model).replace(
        "duration_s: 5", "duration_s: 40"
    )
    text = text.replace("runs: 40", "runs: 100").replace("speed_mps: 5", "speed_mps: 15")
    radar = (
        "  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}\n"
    )
    text = text.replace("trackers:\n", f"{radar}trackers:\n  ukf: {{filter: ukf, {model[1:-1]}}}\n")
    (tmp_path / "own.yaml").write_text(
        text.replace("ukf: {filter: ukf, motion: ctrv, acceleration_sigma_mps2: 1, yaw_acceleration_sigma_radps2: 0.3",
                     "ukf: {filter: ukf, motion: ctrv, acceleration_sigma_mps2: 5, yaw_acceleration_sigma_radps2: 2"),
        encoding="utf-8",
    )  # fmt: skip
    done = cli("tune", "own.yaml", "--trackers", "ukf", "--json", "--test-runs", "10")
    (tracker,) = json.loads(done.out)["trackers"]
    assert tracker["tuned"]["acceleration_sigma_mps2"] == pytest.approx(1.0, rel=0.05)
    assert tracker["tuned"]["yaw_acceleration_sigma_radps2"] == pytest.approx(0.3, rel=0.05)


def test_several_trackers_are_tuned_at_once(cli: Cli) -> None:
    ukf = ("--set", "trackers.ukf={filter: ukf, motion: cv, acceleration_sigma_mps2: 2}", "--train-runs", "2")
    common = ("--range", "acceleration_sigma_mps2=1:4", "--trials", "3", "--json")
    done = cli("tune", "own.yaml", "--trackers", "kf,ukf", *ukf, *common)
    found = {item["name"]: item["tuned"] for item in json.loads(done.out)["trackers"]}
    assert [*found["kf"]] == [*found["ukf"]] == ["acceleration_sigma_mps2"]
    # A range is for all of them.
    done = cli("tune", "own.yaml", "--trackers", "ukf,kf", *ukf, *common, "--range", "kappa=1:3")
    assert done.status == 2
    assert "kf: only filter ukf has this key" in done.err


PLUGIN = """
import numpy as np


class Last:
    def __init__(self, sigma=1.0):
        self.sigma = sigma

    def step(self, state, scan):
        mean = np.array([*scan.measurement[:2], 0.0, 0.0])
        return state, (mean, OFF * self.sigma * np.eye(4))
"""
TUNE = ("tune", "own.yaml", "--trials", "2", "--storage", "study.db", "--train-runs", "2", "--test-runs", "2")


@pytest.fixture
def own_file(tmp_path: Path) -> Path:
    file = tmp_path / "own.yaml"
    file.write_text(SCENARIO.replace("{use: raw}", "{use: 'last:Last'}"), encoding="utf-8")
    (tmp_path / "last.py").write_text(PLUGIN.replace("OFF", "1"), encoding="utf-8")
    return file


def test_a_search_with_another_setting_has_a_study_of_its_own(cli: Cli, own_file: Path, tmp_path: Path) -> None:
    kf = (*TUNE, "--trackers", "kf")
    for number, arguments in enumerate(
        (
            (),
            ("--range", "acceleration_sigma_mps2=1:2"),
            ("--set", "sensors.lidar.position_sigma_m=0.2"),
            ("--seed", "3"),
            ("--objective", "position_rmse"),
        ),
        1,
    ):
        for _ in range(2):
            assert cli(*kf, *arguments).status == 0
            assert trials(tmp_path / "study.db") == 2 * number


def test_a_search_with_another_plug_in_has_a_study_of_its_own(cli: Cli, own_file: Path, tmp_path: Path) -> None:
    last = (*TUNE, "--trackers", "raw", "--range", "options.sigma=0.1:10", "--objective", "position_rmse")
    assert cli(*last).status == 0, cli(*last).err
    own_file.with_name("last.py").write_text(PLUGIN.replace("OFF", "2"), encoding="utf-8")
    assert cli(*last).status == 0
    assert trials(tmp_path / "study.db") == 4

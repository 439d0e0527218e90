"""What a tuning amounts to: in words, and in the scenario that is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.subjects.tuning.test_tuning import TEXT

import trackbench as tb
from trackbench.api.scenario import load
from trackbench.scenario import Scenario, load_scenario
from trackbench.subjects.tuning.files import tuned_scenario_text
from trackbench.subjects.tuning.report import tuning_headline
from trackbench.subjects.tuning.tables import held_out_table
from trackbench.subjects.tuning.tune import Tuning

SCENARIO = {
    "name": "turn",
    "truth": {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 10,
        "objects": {"car": {"start": {"x": 60, "y": 0, "vx_mps": 8}, "pieces": [{"turn_rate_degps": 10}]}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15}},
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 3}},
    "monte_carlo": {"runs": 3, "seed": 4},
}


@pytest.fixture(scope="module")
def tuning() -> Tuning:
    return tb.tune(load(SCENARIO), ["kf"], ranges=["acceleration_sigma_mps2=0.5:10"], trials=3)["kf"]


@pytest.mark.parametrize(
    ("verdict", "text"),
    [
        ("better", "better than the start"),
        ("undecided", "not shown to be better or worse than the start: a gain may be noise"),
        ("worse", "worse than the start"),
    ],
)
def test_a_headline_says_what_is_shown_and_the_table_on_what(tuning: Tuning, verdict: str, text: str) -> None:
    one = replace(tuning.held_out.of("log_likelihood")[0], verdict=verdict)
    found = replace(tuning, start={}, held_out=replace(tuning.held_out, comparisons=(one,)))
    assert tuning_headline(found)[0].split(": ", 1)[1] == text
    assert held_out_table(found).caption == "On other noise of the same motion"


FOUND = {"a": {"acceleration_sigma_mps2": 1.25}}
CV: dict[str, Any] = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2}
LOG: dict[str, Any] = {
    "name": "log",
    "truth": {
        "source": "recording",
        "format": "csv",
        "readings": {"lidar": {"path": "lidar.csv", "time": "t", "x": "x", "y": "y"}},
        "ego": {"path": "car/ego.csv", "time": "t", "px": "x", "py": "y", "yaw": "yaw"},
    },
    "sensing": {"identities": "hidden"},
    "sensors": {"lidar": {"type": "lidar", "position_sigma_m": 0.2, "max_range_m": 50}},
    "monte_carlo": {"runs": 1},
    "trackers": {"gnn": {**CV, "associate": {"method": "gnn"}}},
}


def test_the_values_are_written_into_the_scenario(tmp_path: Path) -> None:
    scenario = load(TEXT)
    found = {"ekf": {"acceleration_sigma_mps2": 1.25}, "ukf": {"initial.skip": 2}, "many_2": {"initial.skip": 1}}
    text = tuned_scenario_text(scenario, found, tmp_path)
    again = load(text)
    assert (
        again.config.trackers["ekf"]
        == load(TEXT, {"trackers.ekf.acceleration_sigma_mps2": 1.25}).config.trackers["ekf"]
    )
    assert again.config.trackers["ekf_start"] == scenario.config.trackers["ekf"]
    assert again.config.trackers["lidar_only"] == scenario.config.trackers["lidar_only"]
    assert again.config.trackers["many_2_start"] == scenario.config.trackers["many_2"]
    assert again.config.trackers["ukf"].initial.skip == 2  # type: ignore[union-attr]


def with_trackers(trackers: str) -> Scenario:
    return load(TEXT[: TEXT.index("trackers:")] + trackers + "\nmonte_carlo: {runs: 3, seed: 4}\n")


FLOW = "{filter: ekf, motion: cv, acceleration_sigma_mps2: 2}"


@pytest.mark.parametrize(
    "trackers",
    [
        f"trackers: {{\n  a: {FLOW},\n  b: {FLOW}\n}}",
        f"trackers:\n  ? a\n  : {FLOW}\n  b: {FLOW}",
        f"trackers:\n  b: &b {FLOW}\n  <<: {{a: {FLOW}}}",
        f"trackers:\n  b: {FLOW}\n  a: {{<<: {FLOW}, kappa: 0.123456789012345}}".replace("ekf", "ukf"),
    ],
)
def test_a_scenario_of_any_form_is_written(trackers: str, tmp_path: Path) -> None:
    scenario = with_trackers(trackers)
    text = tuned_scenario_text(scenario, FOUND, tmp_path)
    again = load(text).config.trackers
    before = scenario.config.trackers
    assert again == {
        "a": load(scenario.text, {"trackers.a.acceleration_sigma_mps2": 1.25}).config.trackers["a"],
        "a_start": before["a"],
        "b": before["b"],
    }


def test_what_was_tuned_is_tuned_again(tmp_path: Path) -> None:
    once = load(tuned_scenario_text(with_trackers(f"trackers:\n  a: {FLOW}"), FOUND, tmp_path))
    again = load(tuned_scenario_text(once, {"a": {"acceleration_sigma_mps2": 1.5}}, tmp_path))
    sigmas = {name: entry.motion.acceleration_sigma_mps2 for name, entry in again.config.trackers.items()}  # type: ignore[union-attr]
    assert sigmas == {"a": 1.5, "a_start": 1.25}


@pytest.mark.parametrize("overrides", [{}, {"monte_carlo.seed": 1}])
def test_a_recording_is_found_from_where_the_scenario_is_written(overrides: dict[str, Any], tmp_path: Path) -> None:
    for name in ("log/lidar.csv", "log/car/ego.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "log" / "log.yaml").write_text(load(LOG).text, encoding="utf-8")
    loaded = load_scenario(tmp_path / "log" / "log.yaml", [f"{k}={v}" for k, v in overrides.items()])
    text = tuned_scenario_text(loaded, {}, tmp_path / "elsewhere")
    truth = load(text).config.truth
    assert truth.measurements["lidar"].path == "../log/lidar.csv"  # type: ignore[attr-defined]
    assert truth.ego.path == "../log/car/ego.csv"  # type: ignore[attr-defined]

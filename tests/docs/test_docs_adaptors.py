"""The page on filters of FilterPy and Stone Soup does what it says."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.places import DOCS

from trackbench.base.errors import InputError
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.adaptors.stonesoup_tracker import MEASURED
from trackbench.trackers.published import create

PAGE = DOCS / "adaptors.md"
EXAMPLES = DOCS / "examples"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    for file in EXAMPLES.glob("own_*"):
        shutil.copy(file, tmp_path)
    assert run_page(PAGE, tmp_path) == 3
    assert (tmp_path / "results" / "own_filters" / "report.html").exists()


def test_the_page_shows_the_files(fenced: Callable[[Path], list[Any]]) -> None:
    shown = {block.note.removeprefix("file: "): block.text for block in fenced(PAGE) if block.note.startswith("file: ")}
    assert shown == {path.name: path.read_text(encoding="utf-8") for path in EXAMPLES.glob("own_*.py")}
    parts = [block for block in fenced(PAGE) if block.note.startswith("part of: ")]
    assert len(parts) == 4
    for block in parts:
        assert block.text in (EXAMPLES / block.note.removeprefix("part of: ")).read_text(encoding="utf-8")


def test_the_models_of_stone_soup_measure_as_many_components_as_is_said() -> None:
    from stonesoup.models.measurement import linear, nonlinear

    for name, measured in MEASURED.items():
        if measured != "position":
            model = getattr(nonlinear, name)
            assert model.ndim_meas.fget(None) == len(measured), name
    assert hasattr(linear, "LinearGaussian")


def test_the_example_s_extended_filter_is_the_built_in_one() -> None:
    loaded = load_scenario(EXAMPLES / "own_filters.yaml", ["monte_carlo.runs=2", "truth.duration_s=4"])
    summary = run_scenario(loaded, truths_of(loaded)).json()
    metrics = {entry["name"]: entry["metrics"] for entry in summary["trackers"]}
    assert all(entry["failed"] is None for entry in summary["trackers"])
    own, built_in = metrics["extended"], metrics["ekf_cv"]
    for name in ("position_rmse", "velocity_rmse"):
        np.testing.assert_allclose(own[name]["value"], built_in[name]["value"], rtol=1e-9)
    for sensor in ("front_radar", "roof_lidar"):
        np.testing.assert_allclose(own["nis"][sensor]["mean"], built_in["nis"][sensor]["mean"], rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"filter": "own_filters:make_efk"},
            "filter: module 'own_filters' has no 'make_efk': did you mean 'make_kf'?",
        ),
        ({"stat": []}, "stat: unknown key; did you mean 'state'?"),
        ({"transition": None, "process_noise": None}, "dt_s: missing: the filter's own F and Q hold for one interval"),
    ],
)
def test_the_messages_of_the_page_are_those_of_the_code(changes: dict[str, Any], message: str) -> None:
    usual = {"filter": "own_filters:ekf", "state": ["px", "vx", "py", "vy"], "initial": "two_measurements"}
    with pytest.raises(InputError) as caught:
        create("filterpy", {**usual, **changes}, EXAMPLES)
    assert message in str(caught.value)
    assert message in PAGE.read_text(encoding="utf-8")

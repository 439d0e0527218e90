"""The pages with commands, above all that on trackers of one's own, do what they say."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.places import DOCS

from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.trackers.published import create

PAGE = DOCS / "own-tracker.md"
EXAMPLES = DOCS / "examples"

Fenced = Callable[[Path], list[Any]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The reader's own folder."""
    for name in ("alpha_beta.py", "alpha_beta.yaml", "alpha_beta_batched.py", "my_filter.py"):
        shutil.copy(EXAMPLES / name, tmp_path)
    return tmp_path


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(folder: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, folder) >= 3
    assert (folder / "results" / "alpha_beta" / "report.html").exists()


@pytest.mark.docs_pages
def test_the_page_on_comparing_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    shutil.copytree(DOCS.parent / "scenarios", tmp_path / "scenarios")
    assert run_page(DOCS / "compare.md", tmp_path) >= 7


@pytest.mark.docs_pages
def test_the_page_on_ci_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "ci.md", tmp_path) == 5
    workflow = yaml.safe_load((tmp_path / "trackers.yml").read_text(encoding="utf-8"))
    steps = workflow["jobs"]["crossing"]["steps"]
    commands = [line for step in steps for line in step.get("run", "").splitlines() if line.startswith("trackbench")]
    assert [command.split()[1] for command in commands] == ["run", "compare"]


@pytest.mark.docs_pages
def test_the_page_on_tuning_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "tune.md", tmp_path) == 3


@pytest.mark.docs_pages
def test_the_page_on_where_the_work_runs_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "execution.md", tmp_path) == 7


@pytest.mark.docs_pages
def test_the_page_on_recordings_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    (tmp_path / "scenarios").mkdir()
    shutil.copy(DOCS.parent / "scenarios" / "highway.yaml", tmp_path / "scenarios")
    assert run_page(DOCS / "reading-a-recording.md", tmp_path) == 3


def test_the_page_on_plug_ins_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "plug-ins.md", tmp_path) == 2


def test_the_page_shows_the_files(fenced: Fenced) -> None:
    shown = {block.note.removeprefix("file: "): block.text for block in fenced(PAGE) if block.note.startswith("file: ")}
    assert shown == {"around.py": (EXAMPLES / "around.py").read_text(encoding="utf-8")}
    for block in fenced(PAGE):
        if block.note.startswith("part of: "):
            assert block.text in (EXAMPLES / block.note.removeprefix("part of: ")).read_text(encoding="utf-8")


def test_the_example_is_honest_and_worth_it() -> None:
    loaded = load_scenario(EXAMPLES / "alpha_beta.yaml", ["monte_carlo.runs=5", "truth.duration_s=5"])
    result = run_scenario(loaded, truths_of(loaded))
    mine = next(entry for entry in result.json()["trackers"] if entry["name"] == "mine")
    assert mine["failed"] is None
    assert 2.5 < mine["metrics"]["nees"]["mean"] < 5
    assert mine["metrics"]["coverage"]["value"] > 0.99
    assert mine["health"]["diverged_runs"] == 0
    assert result.json()["passed"] is True


def test_a_filter_called_from_step_is_the_built_in_one() -> None:
    trackers = {
        "mine": {"use": "around:Around"},
        "kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 3, "initial": {"velocity": "zero"}},
    }
    changes = ["monte_carlo.runs=2", "expect=[]", f"trackers={json.dumps(trackers)}"]
    loaded = load_scenario(EXAMPLES / "alpha_beta.yaml", changes)
    result = run_scenario(loaded, truths_of(loaded))
    assert result["mine"].position_rmse.value == pytest.approx(result["kf"].position_rmse.value, rel=1e-9)


def test_the_entry_point_of_the_page_works(
    tmp_path: Path, fenced: Fenced, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As an installed package leaves it: the module, and its metadata."""
    blocks = fenced(PAGE)
    table = next(block for block in blocks if block.language == "toml")
    published = tomllib.loads(table.text)["project"]["entry-points"]["trackbench.trackers"]
    use = yaml.safe_load(blocks[blocks.index(table) + 1].text)["trackers"]["mine"]
    site, info = tmp_path / "site", tmp_path / "site" / "own-1.0.dist-info"
    info.mkdir(parents=True)
    shutil.copy(EXAMPLES / "alpha_beta.py", site)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own\nVersion: 1.0\n")
    lines = "".join(f"{name} = {value}\n" for name, value in published.items())
    (info / "entry_points.txt").write_text(f"[trackbench.trackers]\n{lines}")
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "alpha_beta", raising=False)
    assert create(use["use"], use["options"])().alpha == 0.4
    assert "alpha_beta" in [line.split()[0] for line in cli("list", "trackers").out.splitlines()]


@pytest.mark.docs_pages
def test_the_page_on_recorded_traffic_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "recorded-traffic.md", tmp_path) >= 4


@pytest.mark.docs_pages
def test_the_page_on_suites_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    shutil.copy(EXAMPLES / "lidar_kalman.py", tmp_path)
    assert run_page(DOCS / "suite.md", tmp_path) == 10
    assert (tmp_path / "entries" / "closed" / "entry.json").is_file()


@pytest.mark.docs_pages
def test_assistants_and_suites_run_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "for-assistants.md", tmp_path) == 7
    assert (tmp_path / "entries" / "alpha" / "entry.json").is_file()


def test_the_page_on_exports_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    shutil.copy(EXAMPLES / "nearest_cars.py", tmp_path)
    assert run_page(DOCS / "export.md", tmp_path) == 3


def test_the_page_on_tracks_from_elsewhere_runs_as_printed(
    tmp_path: Path, run_page: Callable[[Path, Path], int]
) -> None:
    assert run_page(DOCS / "tracks-from-elsewhere.md", tmp_path) >= 3


@pytest.mark.docs_pages
def test_the_page_on_logs_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    shutil.copy(EXAMPLES / "make_log.py", tmp_path)
    assert run_page(DOCS / "own-log.md", tmp_path) >= 5
    assert (tmp_path / "results" / "audit" / "own_log" / "scenario.yaml").exists()

"""Paths of ``--set`` start in the working folder, those of a file in the file's folder."""

from __future__ import annotations

import json
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.scenario.load import load_scenario
from trackbench.scenario.overrides import from_working_folder

Cli = Callable[..., Any]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder, with a folder of scenarios beside it; both have a file ``both.csv``."""
    for name in ("here", "there", "here/logs"):
        (tmp_path / name).mkdir()
    for name in ("here/mine.csv", "here/both.csv", "here/mot", "here/mot.py", "there/both.csv", "there/theirs.csv"):
        (tmp_path / name).touch()
    (tmp_path / "here/logs/a_1.csv").touch()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


@pytest.mark.parametrize(
    ("value", "moved"),
    [
        ("truth.path=mine.csv", "{here}/mine.csv"),
        ("truth.path=theirs.csv", None),
        ("truth.path=$DATA/mine.csv", None),
        ("truth.path=[mine.csv, theirs.csv]", ["{here}/mine.csv", "theirs.csv"]),
        ("truth.readings.radar.path=mine.csv", "{here}/mine.csv"),
        ("trackers.mine.use.command=[./mot, mine.csv, --q, '2']", ["{here}/mot", "{here}/mine.csv", "--q", "2"]),
        ("trackers.mine.use.command=[python3, mot.py]", ["python3", "{here}/mot.py"]),
        ("trackers.mine.use.command=[mot]", None),
        ("monte_carlo.runs=3", None),
    ],
)
def test_files_of_the_working_folder_have_their_full_path(here: Path, value: str, moved: Any) -> None:
    result = from_working_folder(value, here.parent / "there")
    if moved is None:
        assert result == value
    else:
        key, _, text = result.partition("=")
        assert key == value.partition("=")[0]
        assert json.loads(text) == json.loads(json.dumps(moved).replace("{here}", str(here)))
    assert from_working_folder(result, here.parent / "there") == result
    assert from_working_folder(value, here) == value


def test_a_program_beside_the_user_runs_in_a_shipped_scenario(here: Path) -> None:
    program = here / "mot"
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    found = load_scenario("traffic/cut_in", ["trackers.mine.use.command=[./mot]"]).config.trackers["mine"]
    assert found.use.resolved(None) == [str(program)]  # type: ignore[union-attr]

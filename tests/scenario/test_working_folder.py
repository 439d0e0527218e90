"""A program that ``--set`` names is found in the working directory as well as in the scenario's folder."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from trackbench.scenario.load import load_scenario


def test_a_program_beside_the_user_runs_in_a_shipped_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "mot"
    program.touch()
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    loaded = load_scenario("traffic/cut_in", ["trackers.mine.use.command=[./mot]"])
    command = loaded.config.trackers["mine"].use  # type: ignore[union-attr]
    assert command.resolved(loaded.folder) == [str(program)]  # type: ignore[union-attr]
    assert command.files(loaded.folder) == {program}  # type: ignore[union-attr]

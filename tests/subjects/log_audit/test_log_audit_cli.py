"""``trackbench audit``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.recorded_log import Errors, write_log

CLI = Callable[..., Any]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log whose radar is late and has degrees."""
    return write_log(tmp_path, radar=Errors(time_offset_s=-0.08, degrees=True))


def test_a_folder_is_left_and_says_what_was_found(cli: CLI, log: Path) -> None:
    done = cli("audit", log)
    assert done.status == 1
    assert done.err == ""
    assert "2 findings" in done.out
    folder = Path("results/audit/own_log")
    assert sorted(path.name for path in folder.iterdir()) == ["audit.json", "report.html", "report.md", "scenario.yaml"]
    page = (folder / "report.html").read_text(encoding="utf-8")
    # A figure for each component by range, the detections, and the map, which is a replay too.
    assert page.count('class="plot"') == 3 + 1 + 1
    assert page.count('class="replay"') == 1
    assert len(page) < 500_000
    assert cli("check", folder / "scenario.yaml").status == 0
    again = cli("audit", folder / "scenario.yaml", "--out", "again")
    assert again.status == 0
    assert "no finding" in again.out


def test_json_is_all_that_is_printed(cli: CLI, log: Path) -> None:
    done = cli("audit", log, "--json", "--out", "out")
    found = json.loads(done.out)
    assert found == json.loads(Path("out/audit.json").read_text(encoding="utf-8"))
    assert found["changes"]["truth.readings.radar.azimuth"] == "azimuth:deg"
    offset = found["sensors"]["radar"]["errors"]["time_offset"]["interval"]
    assert offset["ci95"][0] < -0.08 < offset["ci95"][1]
    assert [finding["kind"] for finding in found["findings"]] == ["unit", "time_offset"]
    assert found["clocks"][1]["outside"] > 0


def test_trackers_beside_the_scenario_come_with_it(cli: CLI, log: Path) -> None:
    (log.parent / "mine.py").write_text("class Mine:\n    def step(self, state, scan):\n        return None, None\n")
    log.write_text(log.read_text().replace("monte_carlo:", "  mine: {use: 'mine:Mine'}\nmonte_carlo:"))
    assert cli("audit", log, "--out", "far/away").status == 1
    first, left_out = cli("check", "far/away/scenario.yaml").out.splitlines()
    assert first == "far/away/scenario.yaml: ok"
    assert "3 rows outside the time of the truth" in left_out


def test_nothing_else_is_replaced(cli: CLI, log: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("")
    done = cli("audit", log, "--out", "out")
    assert done.status == 2
    assert "it exists and is not a folder with audit.json, so it is not replaced" in done.err


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ("highway", "truth.source: an audit compares recorded measurements with"),
        ("nothing.yaml", "there is no such file"),
    ],
)
def test_what_is_no_log_is_one_message(cli: CLI, scenario: str, message: str) -> None:
    done = cli("audit", scenario)
    assert done.status == 2
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not list(Path("results").glob("audit/*"))

"""``trackbench report``: every format from what was saved."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trackbench.document.html import to_html
from trackbench.report.result import result_document
from trackbench.results import Result

Cli = Callable[..., Any]


@pytest.fixture
def two(tmp_path: Path, tiny_result: Result) -> Path:
    """The saved results of two scenarios."""
    other = tiny_result.summary.scenario.model_copy(update={"name": "other"})
    for result in (tiny_result, tiny_result.updated(scenario=other)):
        result.save(tmp_path / "results" / result.name)
    return tmp_path / "results"


@pytest.mark.parametrize(
    ("format", "expected"),
    [
        ("html", {"report.html"}),
        ("latex", {"tables/ranking.tex", "figures/map.pdf"}),
        ("csv", {"tables/ranking.csv"}),
        ("svg", {"figures/map.svg"}),
        ("terminal", {"report.txt"}),
    ],
)
def test_formats_of_a_saved_run(cli: Cli, two: Path, tmp_path: Path, format: str, expected: set[str]) -> None:
    out = tmp_path / "out"
    done = cli("report", str(two / "tiny"), "--format", format, "--out", str(out))
    assert (done.status, done.err) == (0, "")
    written = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert expected <= written
    assert done.out.startswith(f"{out}/: ")


def test_the_main_file_may_be_named(cli: Cli, two: Path, tmp_path: Path, tiny_result: Result) -> None:
    alone = tmp_path / "page.html"
    assert cli("report", str(two / "tiny"), "--format", "html", "--out", str(alone)).status == 0
    assert alone.read_text(encoding="utf-8") == to_html(result_document(tiny_result))


def test_several_runs_are_a_comparison(cli: Cli, two: Path) -> None:
    shown = cli("report", str(two))
    assert shown.status == 0
    assert "Comparison of trackers" in shown.out
    done = cli("report", str(two), "--format", "csv")
    assert done.status == 0
    assert (two / "tables").is_dir()


def test_a_file_where_a_folder_is_needed(cli: Cli, two: Path) -> None:
    done = cli("report", str(two / "tiny"), "--format", "csv", "--out", "table.csv")
    assert done.status == 2
    assert "name a folder" in done.err


def test_another_json_is_no_comparison(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "tuned.json").write_text('{"highway": {}, "schema_version": 1}', encoding="utf-8")
    done = cli("report", "tuned.json")
    assert (done.status, done.out, done.err) == (2, "", "tuned.json: not a comparison\n")

"""The page on these metrics lists all of them and runs as printed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.places import DOCS

from trackbench.metrics.traffic import TRACK_METRICS

PAGE = DOCS / "traffic-metrics.md"
COMBINED = {"ratio": "ratio of sums", "root": "root of the ratio of sums", "mean": "mean of runs"}


def table() -> str:
    """Every metric as a row."""
    rows = ["| metric | unit | better | over runs | meaning |", "| --- | --- | --- | --- | --- |"]
    for path, metric in TRACK_METRICS.items():
        better = metric.better or ""
        rows.append(f"| `{path}` | {metric.unit} | {better} | {COMBINED[metric.combine]} | {metric.meaning} |")
    return "\n".join(rows) + "\n"


def test_the_page_lists_every_metric_as_the_table_has_it() -> None:
    assert table() in PAGE.read_text(encoding="utf-8")


def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 2

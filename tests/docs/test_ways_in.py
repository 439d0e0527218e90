"""The ways in, one for each reader, do what they say and end in a result of the reader's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

#: What a reader has at the end, by the way in.
RESULTS = {
    "student": ["results/loop/report.html", "results/doctor/mine/report.html"],
    "engineer": ["tuned.yaml", "tuned/commute/result.json"],
    "researcher": ["differences-differences-velocity_rmse.tex", "latex/tables/ranking.tex", "worlds/comparison.html"],
    "team-lead": ["nights.html", "A/approach-envelope/claim.json"],
    "maintainer": ["fading.py", "results/plugged/report.html"],
}


@pytest.mark.docs_pages
@pytest.mark.parametrize("reader", RESULTS)
def test_a_way_in_runs_as_printed(reader: str, tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    if reader == "engineer":
        pytest.importorskip("optuna", reason="needs trackbench[tune]")
    assert run_page(DOCS / "start" / f"{reader}.md", tmp_path) >= 4
    for file in RESULTS[reader]:
        assert (tmp_path / file).is_file(), file

"""The page on functions."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

import trackbench as tb

PAGE = DOCS / "functions.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 3


def test_the_table_has_the_figures_of_the_scenario(tmp_path: Path, fenced: Callable) -> None:
    (tmp_path / "braking_lead.yaml").write_text(fenced(PAGE)[0].text, encoding="utf-8")
    result = tb.run(tmp_path / "braking_lead.yaml")
    row = re.compile(r"^\| `(ekf_\d+)` \| (.*) m \| (.*) s \| (.*) to (.*) s \| (.*) s \|$", re.MULTILINE)
    rows = row.findall(PAGE.read_text(encoding="utf-8"))
    assert [name for name, *_ in rows] == ["ekf_2", "ekf_4", "ekf_8", "ekf_16"]
    for name, *printed in rows:
        metrics = result[name].metrics
        delay = metrics["warn_delay.fcw"]
        values = metrics["position_rmse"].value, delay.value, delay.p05, delay.p95, metrics["warn_error.fcw"].value
        assert [float(text) for text in printed] == pytest.approx(values, abs=0.002), name
    assert result.summary.passed

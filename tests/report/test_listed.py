"""Pages of a result with more trackers than anybody reads."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from trackbench.document.markdown import to_markdown
from trackbench.report.console import print_summary
from trackbench.report.result import result_document
from trackbench.results import Result


def printed(result: Result) -> str:
    """What a run prints."""
    output = io.StringIO()
    print_summary(result, Console(file=output, width=80))
    return output.getvalue()


def test_a_page_lists_the_first_of_the_ranking(tiny_result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    best, other = tiny_result.summary.ranking
    assert tiny_result.listed is tiny_result
    assert f"**{other}**" in to_markdown(result_document(tiny_result))
    assert "more: result.json" not in printed(tiny_result)
    monkeypatch.setattr("trackbench.results.result.MOST_LISTED", 1)
    result = Result(tiny_result.summary, tiny_result.tables)
    assert [tracker.name for tracker in result.listed.scored] == [best]
    assert result.listed.differences == []
    assert result.differences == tiny_result.differences
    page = to_markdown(result_document(result))
    assert "The first 1 of 2 trackers are listed here" in page
    assert "2 trackers" in page
    assert f"**{best}**" in page
    assert f"**{other}**" not in page
    assert "1 more: result.json" in printed(result)

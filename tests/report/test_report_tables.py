"""The tables of one run in the terminal and in Markdown, and the letters that say which differences are real."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Sequence
from itertools import combinations

import pytest
from rich.console import Console
from tests.support.example_result import RMSE, make_result
from tests.support.results import with_differences

from trackbench.document.markdown import to_markdown
from trackbench.report.console import print_summary
from trackbench.report.pairs import Pairs, group_letters
from trackbench.report.result import result_document
from trackbench.results import Result


@pytest.fixture(scope="module")
def result() -> Result:
    return make_result()


def test_markdown_table(result: Result) -> None:
    lines = to_markdown(result_document(result)).splitlines()
    start = lines.index("## Ranking") + 4
    assert lines[start].count("|") == lines[start + 2].count("|")
    assert lines[start + 2].startswith("| **ukf_ctrv** | 0.382 (±0.008) | a |")
    assert "1. n/a: the tracker gives no covariance" in lines
    assert any(line.startswith("- **mine**: ValueError: matrix \\<3\\> is singular") for line in lines)


@pytest.mark.parametrize("width", [80, 120])
def test_terminal_output_fits(result: Result, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    output = io.StringIO()
    print_summary(result, Console(file=output, width=width), wide=True)
    text = output.getvalue()
    assert max(len(line) for line in text.splitlines()) <= width
    assert "\x1b" not in text
    assert all(name in text for name in (*RMSE, "mine"))
    assert "0.412 ±0.008" in text
    rows = {line.split()[0]: " ".join(line.split()) for line in reversed(text.splitlines()) if line.split()}
    words = "off in places" if width == 80 else "too small while turning and too large on straights"
    assert rows["ekf_ctrv"].startswith(f"ekf_ctrv 0.39 ██ +1 % not shown 4.1 {words}")
    assert rows["raw"].startswith("raw 1.93 ██████▶ x5.1 worse 4.0 about right")
    assert "FAILED ekf_cv position_rmse 0.412, wanted below 0.4" in text
    assert "ekf_cv position_rmse below 0.5" not in text
    assert re.search(r"^FAILED mine: ValueError: matrix <3> is singular", text, re.MULTILINE)


def pairs_of(names: Sequence[str], differ: Collection[tuple[str, str]], result: Result) -> Pairs:
    """Of trackers of which the first of each pair in ``differ`` is better."""
    pattern = result.differences[0]
    differences = [
        pattern.model_copy(update={"a": a, "b": b, "better": a if (a, b) in differ else None, "verdict": "undecided"})
        for a, b in combinations(names, 2)
    ]
    return Pairs(with_differences(result, differences))


def test_letters_say_exactly_who_differs(result: Result) -> None:
    names = ["a", "b", "c", "d"]
    differ = {("a", "c"), ("a", "d"), ("b", "d")}
    shown = group_letters(names, pairs_of(names, differ, result).differ)
    for a, b in combinations(names, 2):
        assert bool(set(shown[a]) & set(shown[b])) == ((a, b) not in differ)
    assert shown == {"a": "a", "b": "ab", "c": "bc", "d": "c"}

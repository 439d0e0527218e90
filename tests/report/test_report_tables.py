"""The tables of one run in the terminal and in Markdown, and the letters that say which differences are real."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any

import pytest
from rich.console import Console
from tests.support.example_result import RMSE, make_result
from tests.support.results import with_differences

from trackbench.document.markdown import to_markdown
from trackbench.metrics.differences import MOST_PAIRED
from trackbench.report.console import print_summary, words_explained
from trackbench.report.pairs import Pairs, group_letter, groups
from trackbench.report.result import result_document
from trackbench.results import ConditionVerdict, MetricValue, Result


@pytest.fixture(scope="module")
def result() -> Result:
    return make_result()


def test_a_word_with_two_explanations_names_whose_each_is(result: Result) -> None:
    first, second = result.scored[:2]
    braking = ConditionVerdict(name="braking", mean=8.2, ci95=(6.2, 19.0), verdict="optimistic")
    of_mean = MetricValue(value=6.0, unit="1", dof=4, ci95=(5.5, 6.5), verdict="optimistic")
    of_braking = of_mean.model_copy(update={"value": 3.9, "ci95": (3.6, 4.8), "conditions": (braking,)})
    lines = words_explained(
        [
            tracker.model_copy(update={"metrics": {"nees": nees}})
            for tracker, nees in ((first, of_mean), (second, of_braking))
        ]
    )
    said = "the errors are larger than its covariance states"
    assert lines == [
        f"optimistic ({first.name}): {said}",
        f"optimistic ({second.name}): {said}, as shown for braking; the mean NEES is undecided",
    ]


def test_markdown_table(result: Result) -> None:
    lines = to_markdown(result_document(result)).splitlines()
    start = lines.index("## Ranking") + 4
    assert lines[start].count("|") == lines[start + 2].count("|")
    assert lines[start + 2].startswith("| 1 | **ukf_ctrv** | 0.382 (±0.008) | a |")
    assert "1. n/a: the tracker gives no covariance" in lines
    assert any(line.startswith("- **mine**: ValueError: matrix \\<3\\> is singular") for line in lines)


def test_markdown_holds_the_whole_report(result: Result) -> None:
    text = to_markdown(result_document(result))
    headings = [line.removeprefix("## ") for line in text.splitlines() if line.startswith("## ")]
    assert headings == [
        "Verdict",
        "Ranking",
        "Differences between trackers",
        "Worst moments",
        "By manoeuvre and range",
        "Consistency",
        "Expectations",
        "Truth and sensors",
        "How to reproduce it",
    ]
    assert "1 of 2 expectations failed." in text
    assert result.summary.command in text
    assert "None" not in text


@pytest.mark.parametrize("width", [80, 120])
def test_terminal_output_fits(result: Result, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    output = io.StringIO()
    print_summary(result, Console(file=output, width=width))
    text = output.getvalue()
    assert max(len(line) for line in text.splitlines()) <= width
    assert "\x1b" not in text
    assert all(name in text for name in (*RMSE, "mine"))
    assert "0.412 ±0.008" in text
    assert "mixed: errors larger or smaller than stated, by condition (NEES, 4 expected):" in text
    assert "  ekf_ctrv: turning 39.7, straight 2.9" in text
    assert "FAILED ekf_cv position_rmse 0.412, wanted below 0.4" in text
    assert "ekf_cv position_rmse below 0.5" not in text
    assert re.search(r"^mine +FAILED: ValueError: matrix <3> is singular", text, re.MULTILINE)


def test_terminal_colours_only_where_wanted(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    def printed(**options: Any) -> str:
        output = io.StringIO()
        print_summary(result, Console(file=output, width=80, force_terminal=True, **options))
        return output.getvalue()

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[31m" in printed(color_system="standard") or "\x1b[1;31m" in printed(color_system="standard")
    monkeypatch.setenv("NO_COLOR", "1")
    assert "31m" not in printed()


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
    shown = groups(names, pairs_of(names, differ, result))
    for a, b in combinations(names, 2):
        assert bool(set(shown[a]) & set(shown[b])) == ((a, b) not in differ)
    assert shown == {"a": "a", "b": "ab", "c": "bc", "d": "c"}


def test_more_groups_than_letters_are_told_apart(result: Result) -> None:
    names = [f"t{i}" for i in range(MOST_PAIRED)]
    # Neighbours alone share a group, of which there are 29.
    differ = {(a, b) for (i, a), (j, b) in combinations(enumerate(names), 2) if j - i > 1}
    shown = {name: set(cell.split()) for name, cell in groups(names, pairs_of(names, differ, result)).items()}
    assert len(set().union(*shown.values())) == MOST_PAIRED - 1
    for a, b in combinations(names, 2):
        assert bool(shown[a] & shown[b]) == ((a, b) not in differ)
    assert [group_letter(i) for i in (0, 25, 26, 51, 52, 701, 702)] == ["a", "z", "aa", "az", "ba", "zz", "aaa"]

"""Comparisons of runs of hidden identities."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.results import with_differences

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.compare import Limit, compare_results, load_comparison
from trackbench.document.files import document_text
from trackbench.report.comparison.document import comparison_document, comparison_files
from trackbench.report.junit import suites_of_comparison
from trackbench.results import Result


def test_trackers_are_compared_by_tgospa(traffic_result: Result) -> None:
    comparison = compare_results([traffic_result])
    assert comparison.ranked_by == "tgospa"
    for item in comparison.differences:
        assert item.metric == "tgospa"
        ours = traffic_result[item.entrant.tracker].metrics["tgospa"].value
        theirs = traffic_result[item.against.tracker].metrics["tgospa"].value
        assert ours is not None
        assert theirs is not None
        assert item.difference == pytest.approx(ours - theirs)
    (stored,) = (d for d in traffic_result.differences if (d.metric, d.a, d.b) == ("tgospa", *_pair(traffic_result)))
    (item,) = (d for d in comparison.differences if (d.entrant.tracker, d.against.tracker) == _pair(traffic_result))
    assert item.ci95 == pytest.approx(stored.ci95)


def _pair(result: Result) -> tuple[str, str]:
    return result.summary.ranking[0], result.summary.ranking[-1]


def test_over_scenarios_trackers_are_ranked_by_tgospa(traffic_result: Result) -> None:
    other = traffic_result.updated(scenario=traffic_result.summary.scenario.model_copy(update={"name": "again"}))
    page = document_text(comparison_document(compare_results([[traffic_result, other]])))
    assert "T-GOSPA against oracle" not in page
    assert "T-GOSPA against " in page
    assert "Switches a minute of an object" in page
    assert "consistent" not in page


def test_a_reference_is_shown_and_never_the_best(traffic_result: Result) -> None:
    def alone(result: Result) -> Result:
        names = [name for name in result.summary.ranking if name != "oracle"]
        return result.updated(trackers=[result[name] for name in result if name in names], ranking=names)

    # With no error at all it would be far ahead.
    perfect = [
        pair.model_copy(update={"better": "oracle"}) if "oracle" in (pair.a, pair.b) else pair
        for pair in traffic_result.differences
    ]
    first = with_differences(traffic_result, perfect).updated(
        ranking=["oracle", *alone(traffic_result).summary.ranking]
    )
    assert first.contenders[0].name != "oracle"
    comparison = compare_results([[first, renamed(first, "again")]])
    without = compare_results([[alone(first), alone(renamed(first, "again"))]])
    *others, reference = comparison.ranking
    assert (reference.tracker, reference.reference) == ("oracle", True)
    assert others == without.ranking
    assert not any(score.leading for score in comparison.scores if score.entrant.tracker == "oracle")
    page = document_text(comparison_document(comparison))
    assert "oracle (reference)" in page
    assert "scenarios with the same scenes count as fully correlated: three_cars and again." in " ".join(page.split())
    assert "oracle has the best" not in page


def test_known_and_hidden_identities_are_not_compared(traffic_result: Result, tiny_result: Result) -> None:
    for results, here, there in (
        ((tiny_result, traffic_result), "hidden", "known"),
        ((traffic_result, tiny_result), "known", "hidden"),
    ):
        with pytest.raises(InputError, match=f"with results 1: identities are {here} here and {there} there"):
            compare_results(results)


def renamed(result: Result, name: str) -> Result:
    return result.updated(scenario=result.summary.scenario.model_copy(update={"name": name}))


def no_truth(result: Result, name: str) -> Result:
    return renamed(result, name).updated(truth=result.summary.truth.model_copy(update={"known": False}))


def test_scenarios_of_each_kind_are_compared_apart(traffic_result: Result, tiny_result: Result, tmp_path: Path) -> None:
    both = [traffic_result, renamed(traffic_result, "again"), tiny_result, no_truth(traffic_result, "recorded")]
    comparison = compare_results([both])
    assert [(group.ranked_by, [scenario.name for scenario in group.scenarios]) for group in comparison.groups] == [
        ("tgospa", ["three_cars", "again"]),
        ("position_rmse", ["tiny"]),
    ]
    alone = compare_results([both[:2]]), compare_results([tiny_result])
    for group, same in zip(comparison.groups, alone, strict=True):
        assert (group.ranking, group.scores) == (same.ranking, same.scores)
        assert [item.difference for item in group.differences] == [item.difference for item in same.differences]
    page = comparison_document(comparison)
    for items in (page.tables, page.figures):
        assert len({item.name for item in items}) == len(items) > 0
    shown = document_text(page)
    assert "By T-GOSPA over 2 scenarios" in shown
    assert "By position RMSE: tiny" in shown
    assert "recorded not compared: no truth" in shown
    for file, content in comparison_files(comparison, tmp_path / "comparison.json"):
        file.write_bytes(content)
    assert load_comparison(tmp_path / "comparison.json").json() == comparison.json()


def test_a_limit_holds_where_its_metric_is(traffic_result: Result, tiny_result: Result) -> None:
    both = [traffic_result, tiny_result]
    comparison = compare_results([both, both], limits=[Limit("gospa", 5.0)])
    assert comparison.passed
    assert {item.metric for group in comparison.groups for item in group.gates} == {"gospa"}
    assert [len(suite.cases) for suite in suites_of_comparison(comparison)] == [4, 0]
    assert "no gospa in tiny, so its limit says nothing of it" in comparison.notes
    with pytest.raises(InputError, match=r"--metric: 'velocity' has no values by run to compare; did you mean"):
        compare_results([both], metrics=["velocity"])


def test_another_cutoff_is_another_score(traffic_text: str, traffic_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text + "score: {cutoff_m: 3}\n", encoding="utf-8")
    other = tb.run(tmp_path / "three_cars.yaml")
    with pytest.raises(InputError, match=r"another scenario: score\.cutoff_m is 3.* here and 5.* there"):
        compare_results([Result.load(traffic_folder), other])


def test_a_batch_of_both_is_run_and_each_kind_compared(
    cli: Callable[..., Any], tiny: Path, traffic_text: str, tmp_path: Path
) -> None:
    (tmp_path / "three_cars.yaml").write_text(traffic_text, encoding="utf-8")
    done = cli("run", tiny, "three_cars.yaml", "--runs", "2")
    assert done.status == 0
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == ["three_cars", "tiny"]
    assert "Comparison of" not in done.out
    (tmp_path / "more_cars.yaml").write_text(traffic_text.replace("three_cars", "more_cars"), encoding="utf-8")
    done = cli("run", tiny, "three_cars.yaml", "more_cars.yaml", "--runs", "2", "--no-recording")
    assert done.status == 0
    assert done.out.splitlines()[-1] == "Comparison of 3 scenarios: results/comparison.md"
    page = (tmp_path / "results" / "comparison.md").read_text(encoding="utf-8")
    assert "## By position RMSE: tiny" in page
    assert "## By T-GOSPA over 2 scenarios" in page

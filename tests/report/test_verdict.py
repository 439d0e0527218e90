"""The first line of a run on a terminal, and the rows and functions below it."""

from __future__ import annotations

from itertools import combinations

import pytest
from tests.support.example_result import make_result
from tests.support.results import with_differences

from trackbench.document.markdown import to_markdown
from trackbench.report.first_screen import at_a_glance
from trackbench.report.pairs import standing
from trackbench.report.result import result_document
from trackbench.report.sentences import answer_of_run, verdict_of_run
from trackbench.report.tables import tone_of
from trackbench.results import ExpectationResult, Health, MetricValue, Result


def result_where(names: list[str], verdicts: dict[tuple[str, str], str], *held: ExpectationResult) -> Result:
    """Of the trackers ``names`` alone; the first of a pair is better unless ``verdicts`` say otherwise."""
    whole = make_result()
    pattern = whole.differences[0]
    items = []
    for a, b in combinations(names, 2):
        word = verdicts.get((a, b), "different")
        better = a if word == "different" else None
        items.append(pattern.model_copy(update={"a": a, "b": b, "verdict": word, "better": better}))
    trackers = [tracker for tracker in whole.summary.trackers if tracker.name in names]
    update = {"trackers": trackers, "ranking": names, "expectations": list(held)}
    return with_differences(whole.updated(**update), items)


def said(result: Result) -> str:
    """Without the scenario's name."""
    return verdict_of_run(result).removeprefix(f"{result.name}: ")


BEST, NEXT, THIRD = "ukf_ctrv", "ekf_ctrv", "ekf_cv"


@pytest.mark.parametrize(
    ("verdicts", "sentence"),
    [
        ({}, "ukf_ctrv is best{here}: position error 0.382 m, shown better than ekf_ctrv and ekf_cv"),
        (
            {(BEST, NEXT): "undecided"},
            "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_ctrv{here}",
        ),
        (
            {(BEST, NEXT): "equivalent"},
            "ukf_ctrv and ekf_ctrv are best{here} (position error 0.382 m and 0.385 m; the same within 5 mm)",
        ),
        # Two that differ from each other are not called alike, though neither is shown to differ from the best.
        (
            {(BEST, NEXT): "undecided", (BEST, THIRD): "undecided"},
            "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_ctrv and ekf_cv{here}",
        ),
    ],
)
def test_who_is_best_how_surely(verdicts: dict[tuple[str, str], str], sentence: str) -> None:
    assert said(result_where([BEST, NEXT, THIRD], verdicts)) == sentence.format(here=" in this scene")


def test_a_tracker_that_diverged_is_tied_with_none_by_its_interval() -> None:
    result = result_where([BEST, NEXT], {(BEST, NEXT): "undecided"})
    lost = [
        tracker.model_copy(update={"health": Health(diverged_runs=1 if tracker.name == NEXT else 0)})
        for tracker in result.summary.trackers
    ]
    diverged = result.updated(trackers=lost)
    best = "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_ctrv (diverged) in this scene"
    assert said(diverged) == f"ekf_ctrv diverged in 1 of 100 runs; {best}"
    assert standing(diverged).cells == ["a", "diverged"]
    screen = to_markdown(result_document(diverged))
    assert f"**{answer_of_run(diverged)}.**" in screen.replace("\\", "")
    first, second = (row[1] for row in at_a_glance(diverged, 2).rows)
    assert first.details[0].startswith("±")
    assert (second.details, second.tone) == (("diverged in 1 of 100 runs",), "bad")
    # Shown to be worse all the same, it has its letter.
    assert standing(result_where([BEST, NEXT], {}).updated(trackers=lost)).cells == ["a", "b"]


def test_a_tracker_that_diverged_hides_no_verdict_on_the_others() -> None:
    result = result_where([BEST, NEXT, THIRD], {(BEST, NEXT): "equivalent", (BEST, THIRD): "undecided"})
    lost = [
        tracker.model_copy(update={"health": Health(diverged_runs=1 if tracker.name == THIRD else 0)})
        for tracker in result.summary.trackers
    ]
    best = "ukf_ctrv and ekf_ctrv are best in this scene"
    assert said(result.updated(trackers=lost)).startswith(f"ekf_cv diverged in 1 of 100 runs; {best} (")


def test_a_mean_that_is_shown_above_is_no_milder_than_optimistic() -> None:
    nees = MetricValue(unit="1", value=7e7, ci95=(8e6, 7e8), dof=4, verdict="mixed")
    assert tone_of(nees) == tone_of(nees.model_copy(update={"verdict": "optimistic"})) == "bad"
    assert tone_of(nees.model_copy(update={"value": 4.0, "ci95": (3.9, 4.1)})) == "warn"

"""The first line of a run on a terminal, and the rows and functions below it."""

from __future__ import annotations

import io
from itertools import combinations

import pyarrow as pa
import pytest
from rich.console import Console
from tests.support.example_result import make_result, make_summary, make_tables
from tests.support.results import with_differences

from trackbench.document.markdown import to_markdown
from trackbench.report.console import print_summary, run_in_words
from trackbench.report.first_screen import at_a_glance, next_step
from trackbench.report.moments import diverged_elsewhere
from trackbench.report.pairs import standing
from trackbench.report.result import result_document
from trackbench.report.scenes import basis_of_intervals
from trackbench.report.sentences import answer_of_run, verdict_of_run
from trackbench.report.tables import tone_of
from trackbench.results import ExpectationResult, Health, MetricValue, Result
from trackbench.results.scenario_summary import SceneSummary


def expectation(metric: str = "position_rmse", *, passed: bool = True) -> ExpectationResult:
    return ExpectationResult(
        tracker="ekf_cv", metric=metric, operator="below", limit=0.4, value=0.3, passed=passed, text=f"{metric} below"
    )


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
        ({}, "ukf_ctrv has the smallest position error, 0.382 m; shown better than ekf_ctrv and ekf_cv"),
        (
            {(BEST, NEXT): "undecided"},
            "ukf_ctrv and ekf_ctrv have the smallest position error, 0.382 to 0.385 m; not shown to differ",
        ),
        (
            {(BEST, NEXT): "equivalent"},
            "ukf_ctrv and ekf_ctrv have the smallest position error, 0.382 to 0.385 m; equivalent within 5 mm",
        ),
        # Equivalent to the best, but not to each other.
        (
            {(BEST, NEXT): "equivalent", (BEST, THIRD): "equivalent"},
            "ukf_ctrv has the smallest position error, 0.382 m; equivalent to ekf_ctrv and ekf_cv within 5 mm",
        ),
        # One whose error is far outside the interval of the best has not the smallest too.
        (
            {(BEST, THIRD): "undecided"},
            "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_cv",
        ),
        # Two that differ from each other are not called alike, though neither is shown to differ from the best.
        (
            {(BEST, NEXT): "undecided", (BEST, THIRD): "undecided"},
            "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_ctrv and ekf_cv",
        ),
    ],
)
def test_who_is_best_how_surely(verdicts: dict[tuple[str, str], str], sentence: str) -> None:
    assert said(result_where([BEST, NEXT, THIRD], verdicts)) == f"{sentence} in this scene"


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [(3.53, 0.9, "3.53 m"), (4.47, 0.9, "4.47 m"), (0.0712, 0.03, "0.0712 m"), (41.26, 9.0, "41.3 m")],
)
def test_a_value_has_three_digits_however_wide_its_interval(value: float, half: float, shown: str) -> None:
    """Values of runs that differ are told apart: both 3.53 and 4.47 were "4 m"."""
    result = result_where([BEST], {})
    (tracker,) = result.summary.trackers
    metric = tracker.position_rmse.model_copy(update={"value": value, "ci95": (value - half, value + half)})
    wide = result.updated(
        trackers=[tracker.model_copy(update={"metrics": {**tracker.metrics, "position_rmse": metric}})]
    )
    assert said(wide) == f"ukf_ctrv has a position error of {shown}"


@pytest.mark.parametrize(
    ("source", "stretches", "words", "runs"),
    [
        ("highway-env", 0, "6 scenes", "6 scenes of 2 runs"),
        ("recording", 6, "6 stretches of one log", "6 stretches of one log"),
        ("recording", 3, "6 stretches of 2 logs", "6 stretches of 2 logs"),
        ("recorded-boxes", 0, "6 sequences", "6 sequences"),
    ],
)
def test_scenes_are_counted_in_the_same_words_everywhere(source: str, stretches: int, words: str, runs: str) -> None:
    result = result_where([BEST, NEXT], {})
    truth = result.summary.truth
    scene = SceneSummary(name="one", objects=["a"], duration_s=5.0, audit=truth.audit, error={BEST: 0.4, NEXT: 0.5})
    options = {"source": source, "scenes": [scene] * 6, "stretches": stretches}
    several = result.updated(runs=12, truth=type(truth).model_validate({**dict(truth), **options}))
    assert said(several).startswith(f"over {words} ukf_ctrv has")
    assert run_in_words(several).startswith(f"{runs}, ")
    assert basis_of_intervals(several).startswith(f"over {words}")
    page = to_markdown(result_document(several))
    assert f"in any of the 6 {words.split()[1]}." in page


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


def test_the_picture_says_who_diverged_in_other_runs() -> None:
    names, runs, lost = ["ekf_tight", "ekf_tight", "ekf_tight", "ekf_cv"], [0.0, 4.0, 7.0, 0.0], [1.0, 1.0, 1.0, 0.0]
    table = pa.table({"tracker": names, "run": runs, "diverged": lost})
    result = Result.from_json(make_summary(), {**make_tables(), "runs": table})
    assert diverged_elsewhere(result) == "Not shown: ekf_tight diverged in run 4 and 1 more."
    document = result_document(result)
    (caption,) = (figure.caption for figure in document.figures if figure.name == "map")
    assert diverged_elsewhere(result) in caption
    assert diverged_elsewhere(result) in to_markdown(document)
    assert not diverged_elsewhere(make_result())


def test_a_mean_that_is_shown_above_is_no_milder_than_optimistic() -> None:
    nees = MetricValue(unit="1", value=7e7, ci95=(8e6, 7e8), dof=4, verdict="mixed")
    assert tone_of(nees) == tone_of(nees.model_copy(update={"verdict": "optimistic"})) == "bad"
    assert tone_of(nees.model_copy(update={"value": 4.0, "ci95": (3.9, 4.1)})) == "warn"


def test_the_margin_that_held_is_said() -> None:
    result = result_where([BEST, NEXT, THIRD], {(BEST, NEXT): "equivalent", (BEST, THIRD): "equivalent"})
    margins = {(BEST, NEXT): 0.0123, (NEXT, THIRD): 0.1}
    items = [item.model_copy(update={"margin": margins.get((item.a, item.b), 0.005)}) for item in result.differences]
    held = with_differences(result, items)
    assert "equivalent to ekf_ctrv and ekf_cv within 5 to 12 mm" in answer_of_run(held)
    assert "no difference over 5 to 100 mm" in standing(held).meaning


def test_a_single_tracker_is_called_best_of_nothing() -> None:
    assert said(result_where([BEST], {})) == "ukf_ctrv has a position error of 0.382 m"


def test_what_went_wrong_comes_first_and_what_went_right_last() -> None:
    best = "ukf_ctrv has a position error of 0.382 m"
    assert said(result_where([BEST], {}, expectation(), expectation())) == f"{best}; all 2 expectations met"
    missed = result_where([BEST], {}, expectation(), expectation(passed=False))
    assert said(missed) == f"1 of 2 expectations failed; {best}"
    assert said(make_result()).startswith("mine failed; ekf_tight diverged in 3 of 100 runs; 1 of 2 exp")


def test_functions_are_in_the_verdict_only_where_something_is_expected_of_them() -> None:
    names = [BEST, NEXT]
    result = result_where(names, {})
    pattern = result[BEST].position_rmse.model_copy(update={"unit": "s"})
    trackers = []
    for tracker in result.summary.trackers:
        late = 0.1 + (tracker.name == NEXT)
        own = {f"{stem}.aeb": pattern.model_copy(update={"value": late}) for stem in ("warn_delay", "warn_error")}
        trackers.append(tracker.model_copy(update={"metrics": {**tracker.metrics, **own}}))
    warned = result.updated(trackers=trackers)
    assert "RMS delay" not in said(warned)
    expected = warned.updated(expectations=[expectation("warn_error.aeb")])
    tied = "smallest RMS delay: all trackers 0.10 to 1.10 s (aeb), not shown to differ; ukf_ctrv has"
    assert said(expected).startswith(tied)
    tested = expected.differences[0].model_copy(update={"metric": "warn_error.aeb"})
    shown = with_differences(expected, [*expected.differences, tested])
    assert said(shown).startswith("smallest RMS delay: ukf_ctrv 0.10 s (aeb); ukf_ctrv has")
    output = io.StringIO()
    print_summary(warned, Console(file=output, width=80))
    assert sum(line.split()[:2] in (["aeb", name] for name in names) for line in output.getvalue().splitlines()) == 2


def test_the_next_step_is_chosen_by_the_result() -> None:
    scenes = {"truth": make_result().summary.truth.model_copy(update={"source": "highway-env", "scenes": []})}
    fine = result_where([BEST, NEXT], {}, expectation()).updated(command="trackbench run mine.yaml", **scenes)
    assert next_step(fine)[1] == "trackbench run mine.yaml --scenes 10"
    missed = result_where([BEST, NEXT], {}, expectation(passed=False)).updated(**scenes)
    assert next_step(missed)[1] == "trackbench inspect . --worst 3"
    recorded = fine.updated(truth=fine.summary.truth.model_copy(update={"source": "recorded"}))
    assert next_step(recorded)[1] == "trackbench view . --worst"
    lost = fine[NEXT].model_copy(update={"health": Health(diverged_runs=1)})
    best, other = fine[BEST], fine[NEXT].model_copy(update={"baseline": True})
    for trackers, name in (([best, lost], NEXT), ([best.model_copy(update={"baseline": True}), fine[NEXT]], NEXT)):
        assert next_step(fine.updated(trackers=trackers))[1] == f"trackbench doctor mine.yaml#{name}"
    assert next_step(fine.updated(trackers=[best, other]))[1] == "trackbench run mine.yaml --scenes 10"

"""The comparison of trackers over scenarios, and its pages."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.support.past_results import scene

from trackbench.base.errors import InputError
from trackbench.compare import Comparison, compare_results
from trackbench.document.latex import table_to_latex
from trackbench.document.markdown import to_markdown
from trackbench.report.comparison.document import comparison_document
from trackbench.report.comparison.over_scenarios import who_is_ahead
from trackbench.results import Result

RUNS = 20
REASON = "ValueError: matrix <3> is singular"


def metrics(rmse: float) -> dict[str, Any]:
    return {
        "position_rmse": {"value": rmse, "unit": "m", "ci95": [rmse - 0.01, rmse + 0.01]},
        "velocity_rmse": {"value": 2 * rmse, "unit": "m/s", "ci95": [2 * rmse - 0.1, 2 * rmse + 0.1]},
        "position_over_reference": {"value": rmse / 0.5, "unit": "1", "ci95": None},
        "nees": {"mean": 4.1, "unit": "1", "dof": 4, "ci95": [3.9, 4.3], "verdict": "consistent"},
        "coverage": {"value": 1.0, "unit": "1"},
        "step_time": {"value": 1.23, "unit": "us"},
    }


def failed_tracker() -> dict[str, Any]:
    place = {"step": 12, "time_s": 0.6, "sensor": "roof_lidar", "run": 0, "object": "v1"}
    nothing = {"value": None, "unit": "m", "reason": "the tracker failed"}
    return {
        "name": "mine",
        "describe": "mypkg:Mine",
        "failed": {"cause": REASON, **place},
        "metrics": {"position_rmse": nothing},
        "health": {},
    }


def runs_table(rmse: dict[str, float], tied: tuple[str, ...]) -> pa.Table:
    """Errors in each run whose root mean square is as given: those that are tied with another vary on their own."""
    common = np.resize([1.0, -1.0], RUNS)
    own = np.resize([1.0, 1.0, -1.0, -1.0], RUNS)
    squares = {name: value**2 * (1 + (0.8 * own if name in tied else 0.1 * common)) for name, value in rmse.items()}
    return pa.table(
        {
            "tracker": np.repeat(list(rmse), RUNS),
            "run": np.tile(np.arange(RUNS, dtype=float), len(rmse)),
            "scene": np.zeros(RUNS * len(rmse)),
            "count": np.full(RUNS * len(rmse), 10.0),
            "position_rmse_m": np.sqrt(np.concatenate(list(squares.values()))),
        }
    )


def scenario(
    name: str, rmse: dict[str, float], tied: tuple[str, ...] = (), failed: bool = False, baseline: str | None = None
) -> Result:
    """A result with the given errors."""
    entries = [
        {
            "name": who,
            "place": place,
            "describe": who,
            "failed": None,
            "metrics": metrics(value),
            "health": {"diverged_runs": 0},
        }
        for place, (who, value) in enumerate(rmse.items())
    ]
    stated = {"tracker": "good", "metric": "position_rmse", "operator": "below", "limit": 1.0, "value": 0.5}
    made = scene().json()
    summary = {
        **made,
        "scenario": {"name": name, "description": f"the {name} one", "file": "x", "text": "", "overrides": []},
        "runs": RUNS,
        "fingerprints": [f"{name} {run}" for run in range(RUNS)],
        "truth": {**made["truth"], "motion": [name]},
        "score": {**made["score"], "baseline": baseline},
        "trackers": [*entries, *([{**failed_tracker(), "place": len(entries)}] if failed else [])],
        "ranking": [*sorted(rmse, key=rmse.__getitem__), *(["mine"] if failed else [])],
        "expectations": [{**stated, "passed": True, "text": "one"}, {**stated, "passed": False, "text": "other"}],
        "passed": False,
    }
    return Result.from_json(summary, {"runs": runs_table(rmse, tied)})


@pytest.fixture(scope="module")
def compared() -> Comparison:
    results = [
        scenario("first", {"good": 0.5, "fair": 0.6, "poor": 2.0}),
        scenario("second", {"good": 0.5, "fair": 0.51, "poor": 1.5}, tied=("fair",)),
        scenario("third", {"good": 0.7, "fair": 0.6, "poor": 1.0}, failed=True),
        scenario("fourth", {"good": 0.4, "poor": 0.9}),
    ]
    return compare_results([results])


def markdown(comparison: Comparison) -> str:
    return to_markdown(comparison_document(comparison), figures="figures")


def test_ranking(compared: Comparison) -> None:
    assert [(item.tracker, item.without_score) for item in compared.ranking] == [
        ("good", 0),
        ("poor", 0),
        ("fair", 1),
        ("mine", 4),
    ]
    good, poor, fair, mine = compared.ranking
    typical = [(0.5 * 0.6 * 2.0) ** (1 / 3), (0.5 * 0.51 * 1.5) ** (1 / 3), (0.7 * 0.6) ** (1 / 3), (0.4 * 0.9) ** 0.5]
    assert good.relative_error == pytest.approx((0.5 * 0.5 * 0.7 * 0.4 / np.prod(typical)) ** 0.25)
    assert fair.relative_error == pytest.approx((0.6 * 0.51 * 0.6 / np.prod(typical[:3])) ** (1 / 3))
    assert mine.relative_error is None
    # Between trackers with a score in all scenarios, the order is that of the pooled difference.
    change = next(item for item in compared.overall if item.entrant.tracker == "poor")
    assert poor.relative_error is not None
    assert change.mean_percent == pytest.approx(100 * (poor.relative_error / good.relative_error - 1))


def test_an_error_of_zero_is_the_smallest() -> None:
    found = compare_results([[scenario(name, {"good": 0.5, "exact": 0.0}) for name in ("one", "two")]])
    assert [(item.tracker, item.relative_error) for item in found.ranking] == [("exact", 0.0), ("good", 1.0)]
    assert who_is_ahead(found) == (
        "It is not known who is ahead over 2 scenarios: in some of them exact or good has no score, or an error of 0."
    )


def test_one_scenario_claims_no_certainty() -> None:
    found = compare_results([scenario("only", {"good": 0.5, "poor": 0.9})])
    assert found.overall == []
    assert "ahead" not in markdown(found)
    assert re.search(r"poor \| good \| 0\.40.* \| worse \| \+80 \| 0\.900 \|", markdown(found).replace("**", ""))


def test_the_pooled_error_says_who_is_ahead() -> None:
    results = [scenario("one", {"good": 0.5, "fair": 0.6}), scenario("two", {"good": 0.5, "fair": 0.48})]
    found = compare_results([results])
    assert [item.tracker for item in found.ranking] == ["good", "fair"]
    (change,) = found.overall
    assert (change.entrant.tracker, change.against.tracker) == ("fair", "good")
    assert change.mean_percent == pytest.approx(100 * ((0.6 * 0.48 / 0.25) ** 0.5 - 1))
    assert who_is_ahead(found).startswith("good is ahead over 2 scenarios: the position RMSE of fair, the next, is 7.3")


def test_without_an_interval_it_is_not_known_how_sure_the_lead_is() -> None:
    results = [scenario(name, {"good": 0.5, "fair": 0.6}) for name in ("one", "two")]
    diverged = [
        result.updated(
            trackers=[
                tracker.model_copy(update={"health": tracker.health.model_copy(update={"diverged_runs": 1})})
                for tracker in result.summary.trackers
            ]
        )
        for result in results
    ]
    assert who_is_ahead(compare_results([diverged])) == (
        "good is ahead over 2 scenarios: the position RMSE of fair, the next, is 20 % larger. "
        "It is not known how sure this is."
    )


def test_trackers_with_the_same_errors_are_not_ahead_of_each_other() -> None:
    found = compare_results([[scenario(name, {"a": 0.5, "b": 0.5}) for name in ("one", "two")]])
    assert who_is_ahead(found) == (
        "No tracker is shown to be ahead over 2 scenarios: beside a, the position RMSE of b is the same."
    )


def test_a_baseline_that_all_scenarios_state_is_what_the_others_are_held_against() -> None:
    rmse = {"good": 0.5, "fair": 0.6, "poor": 0.9}
    found = compare_results([[scenario(name, rmse, baseline="fair") for name in ("one", "two")]])
    assert {item.entrant.tracker: item.against.tracker for item in found.overall} == {"good": "fair", "poor": "fair"}
    assert "than that of fair, the baseline" in who_is_ahead(found)
    # None was held against the best but the baseline, which is worse.
    assert {score.entrant.tracker for score in found.scores if score.leading} == {"good"}


def test_a_named_baseline_takes_the_place_of_the_best_and_changes_no_p_value() -> None:
    rmse = {"good": 0.5, "fair": 0.6, "poor": 0.9}
    results = [scenario(name, rmse) for name in ("one", "two")]
    found, default = compare_results([results], baseline="poor"), compare_results([results])
    assert found.differences == default.differences
    assert [(item.entrant.tracker, item.against.tracker) for item in found.overall] == [
        ("good", "poor"),
        ("fair", "poor"),
    ]
    assert "than that of poor, the baseline" in who_is_ahead(found)
    # In place of a baseline that the scenarios state, which the others alone were compared with.
    stated = [scenario(name, rmse, baseline="fair") for name in ("one", "two")]
    instead = compare_results([stated], baseline="poor")
    assert {item.against.tracker for item in instead.differences} == {"poor"}
    of_stated = compare_results([stated]).differences
    assert all(a.p_value >= b.p_value for a, b in zip(instead.differences, of_stated, strict=True))


def test_one_scenario_is_shown_against_its_baseline() -> None:
    rmse = {"good": 0.5, "fair": 0.6, "poor": 0.9}
    named = compare_results([scenario("only", rmse)], baseline="fair")
    stated = compare_results([scenario("only", rmse, baseline="fair")])
    for found in (named, stated):
        page = comparison_document(found)
        assert {row[1].text for row in page.tables[0].rows} == {"fair"}
        assert "By position RMSE against fair: worse: poor +0.300" in markdown(found)
    assert compare_results([scenario("only", rmse)]).baseline is None


@pytest.mark.parametrize(
    ("sets", "baseline", "message"),
    [
        (1, "god", "no tracker 'god' among the compared ones; did you mean 'good'?"),
        (2, "good", "of several results the first is the baseline: results 1; name a tracker for one result only"),
    ],
)
def test_a_baseline_that_cannot_be_one(sets: int, baseline: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"--baseline: {message}")):
        compare_results([scenario("only", {"good": 0.5, "fair": 0.6})] * sets, baseline=baseline)


def test_trackers_left_out_of_the_correction_are_told() -> None:
    results = [scenario("only", {"good": 0.5, "fair": 0.6, "poor": 0.9})]
    note = "Judged among 2 of the 3 trackers: with all 3 the corrected p-values would be larger."
    assert note in compare_results(results, trackers=["good", "poor"]).notes
    assert compare_results(results, trackers=["good", "fair", "poor"]).notes == compare_results(results).notes == []


def test_differences_over_scenarios_lead_the_page(compared: Comparison) -> None:
    table = comparison_document(compared).tables[0]
    assert [column.heading for column in table.columns] == ["scenario", "poor", "fair"]
    rows = {row[0].text: [(cell.text, cell.details) for cell in row[1:]] for row in table.rows}
    assert list(rows) == ["first", "second", "third", "fourth", "all 4"]
    assert rows["first"][1] == ("+20.00", ("worse",))
    assert rows["fourth"][1] == ("", ())
    few = compare_results([[scenario(name, {"good": 0.5, "fair": 0.6, "poor": 0.9}) for name in ("one", "two")]])
    assert [row[0].text for row in comparison_document(few).tables[0].rows] == ["one", "two", "all 2"]


def test_markdown(compared: Comparison) -> None:
    text = markdown(compared)
    assert "| first | **0.500** (±0.010) | 2.000 (±0.010) | 0.600 (±0.010) |  |" in text
    assert "| second | **0.500** (±0.010) | 1.500 (±0.010) | **0.510** (±0.010) |  |" in text
    assert "| third | 0.700 (±0.010) | 1.000 (±0.010) | **0.600** (±0.010) | failed |" in text
    assert "| fourth | **0.400** (±0.010) | 0.900 (±0.010) |  |  |" in text
    assert "| first | 1.00 (±0.10) | 4.00 (±0.10) | 1.20 (±0.10) |  |" in text
    assert "- **mine**: in third: ValueError: matrix \\<3\\> is singular (step 12, 0.60 s, sensor roof_lidar" in text
    assert "1 of 2 met" in text


def test_a_covariance_is_a_number_and_a_word_in_latex(compared: Comparison) -> None:
    (table,) = (table for table in comparison_document(compared).tables if table.name == "nees")
    assert "first & 4.1 (right) & 4.1 (right) & 4.1 (right) &" in table_to_latex(table)


def test_json(compared: Comparison) -> None:
    found = json.loads(json.dumps(compared.json(), allow_nan=False))
    scores = {(score["scenario"], score["entrant"]["tracker"]): score for score in found["scores"]}
    assert scores["first", "fair"]["metrics"]["position_rmse"]["value"] == 0.6
    assert scores["second", "fair"]["leading"] is True
    assert scores["third", "mine"]["metrics"] == {}
    assert scores["third", "mine"]["failure"].startswith(REASON)
    assert [item["tracker"] for item in found["ranking"]] == ["good", "poor", "fair", "mine"]


def test_a_failed_tracker_is_not_compared_and_that_is_told() -> None:
    found = compare_results([scenario("third", {"good": 0.7, "fair": 0.6}, failed=True)])
    text = markdown(found)
    assert f"position_rmse not compared**: mine in results 1: {REASON}".replace("<", "\\<").replace(">", "\\>") in text
    assert len(found.not_compared) == 2

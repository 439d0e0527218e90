"""The comparison of trackers over scenarios, and its pages."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.support.past_results import scene

from trackbench.compare import Comparison, compare_results
from trackbench.document.markdown import to_markdown
from trackbench.report.comparison.document import comparison_document
from trackbench.report.comparison.figures import rank_groups
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
    assert [item.tracker for item in compared.ranking] == ["good", "fair", "poor", "mine"]
    good, fair, poor, mine = compared.ranking
    # A field of four: places 1 and 2 of 3 are ranks 1 and 2.5, the last of 2 is rank 4; a tie shares its two.
    assert good.mean_rank == pytest.approx((1 + 1.75 + 2 + 1) / 4)
    assert fair.mean_rank == pytest.approx((2.5 + 1.75 + 1) / 3)
    assert poor.mean_rank == pytest.approx((4 + 4 + 3 + 4) / 4)
    assert mine.mean_rank == 4
    assert [item.scenarios for item in compared.ranking] == [4, 3, 4, 1]


def test_real_wins_and_losses(compared: Comparison) -> None:
    good, fair, poor, mine = compared.ranking
    assert (good.won, good.lost, good.tied) == (2 + 1 + 2 + 1, 1, 1)
    assert (fair.won, fair.lost, fair.tied) == (1 + 1 + 3, 1, 1)
    assert (poor.won, poor.lost, poor.tied) == (1, 2 + 2 + 2 + 1, 0)
    assert (mine.won, mine.lost, mine.tied, mine.failed_scenarios) == (0, 3, 0, 1)
    assert sum(item.won for item in compared.ranking) == sum(item.lost for item in compared.ranking)
    assert [(item.consistent_scenarios, item.judged_scenarios) for item in (good, mine)] == [(4, 4), (0, 0)]


def test_ties_share_their_ranks_in_a_scenario(compared: Comparison) -> None:
    ranks = {(score.scenario, score.entrant.tracker): score.rank for score in compared.scores}
    assert [ranks["first", name] for name in ("good", "fair", "poor")] == [1, 2, 3]
    assert [ranks["second", name] for name in ("good", "fair", "poor")] == [1.5, 1.5, 3]
    assert [ranks["third", name] for name in ("good", "fair", "poor", "mine")] == [2, 1, 3, None]


def test_few_scenarios_claim_nothing(compared: Comparison) -> None:
    for item in compared.ranking[:3]:
        assert item.ci95 is not None
        assert 1 <= item.ci95[0] <= item.mean_rank <= item.ci95[1] <= 4
    assert compared.ranking[3].ci95 is None
    assert not any(item.shown for item in compared.rank_differences)
    assert "with 4 trackers that takes 8 sets of scenes, and here are 4." in markdown(compared)


@pytest.mark.parametrize(
    ("scenarios", "claim"),
    [
        (3, "with 2 trackers that takes 6 sets of scenes, and here are 3."),
        (5, "with 2 trackers that takes 6 sets of scenes, and here are 5."),
        (6, "mean rank is shown to be the best (sign-flip test of the ranks over the sets of scenes, p = 0.031)."),
    ],
)
def test_a_leader_everywhere_is_shown_from_enough_scenarios(scenarios: int, claim: str) -> None:
    found = compare_results([[scenario(f"s{i}", {"good": 0.5, "poor": 0.9}) for i in range(scenarios)]])
    (pair,) = found.rank_differences
    assert (pair.a, pair.b, pair.p_value) == ("good", "poor", 2.0 ** (1 - scenarios))
    assert found.ranking[0].ci95 is None
    assert claim in markdown(found)


@pytest.mark.parametrize(
    ("rmse", "letters"),
    [
        ({"good": 0.5, "fair": 0.501}, {"good": "a", "fair": "a"}),
        ({"good": 0.5, "fair": 0.502, "poor": 0.9}, {"good": "a", "fair": "a", "poor": "b"}),
        ({"good": 0.5, "fair": 0.7, "poor": 0.9}, {"good": "a", "fair": "b", "poor": "c"}),
    ],
)
def test_letters_say_whose_mean_ranks_are_shown_to_differ(rmse: dict[str, float], letters: dict[str, str]) -> None:
    found = compare_results([[scenario(f"s{i}", rmse) for i in range(10)]])
    (table,) = (table for table in comparison_document(found).tables if table.name == "ranking")
    place = [column.heading for column in table.columns].index("group")
    assert {row[1].text: row[place].text for row in table.rows} == letters
    few = compare_results([[scenario(f"s{i}", rmse) for i in range(2)]])
    (table,) = (table for table in comparison_document(few).tables if table.name == "ranking")
    assert "group" not in [column.heading for column in table.columns]


def test_the_diagram_joins_what_is_not_shown_to_differ() -> None:
    rmse = {"good": 0.5, "fair": 0.502, "poor": 0.9}
    found = compare_results([[scenario(f"s{i}", rmse) for i in range(10)]])
    assert {(item.a, item.b): item.shown for item in found.rank_differences} == {
        ("good", "fair"): False,
        ("good", "poor"): True,
        ("fair", "poor"): True,
    }
    assert [[item.tracker for item in group] for group in rank_groups(found)] == [["good", "fair"], ["poor"]]


def test_one_scenario_claims_no_certainty() -> None:
    found = compare_results([scenario("only", {"good": 0.5, "poor": 0.9})])
    assert found.ranking[0].ci95 is None
    assert found.rank_differences == []
    assert "lead" not in markdown(found)
    assert re.search(r"poor \| good \| 0\.40.* \| worse \| \+80 \| 0\.900 \|", markdown(found).replace("**", ""))


def test_of_equal_mean_ranks_the_smaller_errors_are_ahead() -> None:
    results = [scenario("one", {"good": 0.5, "fair": 0.6}), scenario("two", {"good": 0.5, "fair": 0.48})]
    found = compare_results([results])
    assert [(item.tracker, item.mean_rank) for item in found.ranking] == [("good", 1.5), ("fair", 1.5)]
    (change,) = found.overall
    assert (change.entrant.tracker, change.against.tracker) == ("fair", "good")
    assert change.mean_percent == pytest.approx(100 * ((0.6 * 0.48 / 0.25) ** 0.5 - 1))
    assert who_is_ahead(found).startswith("good is ahead over 2 scenarios: the position RMSE of fair, the next, is 7.3")


def test_a_baseline_that_all_scenarios_state_is_what_the_others_are_held_against() -> None:
    rmse = {"good": 0.5, "fair": 0.6, "poor": 0.9}
    found = compare_results([[scenario(name, rmse, baseline="fair") for name in ("one", "two")]])
    assert {item.entrant.tracker: item.against.tracker for item in found.overall} == {"good": "fair", "poor": "fair"}
    assert "than that of fair, the baseline" in who_is_ahead(found)
    # None was held against the best but the baseline, which is worse.
    assert {score.entrant.tracker for score in found.scores if score.leading} == {"good"}


def test_differences_over_scenarios_lead_the_page(compared: Comparison) -> None:
    table = comparison_document(compared).tables[0]
    assert [column.heading for column in table.columns] == ["scenario", "fair", "poor"]
    rows = {row[0].text: [(cell.text, cell.details) for cell in row[1:]] for row in table.rows}
    assert list(rows) == ["first", "second", "third", "fourth", "all 4"]
    assert rows["first"][0] == ("+20.00", ("worse",))
    assert rows["fourth"][0] == ("", ())
    few = compare_results([[scenario(name, {"good": 0.5, "fair": 0.6, "poor": 0.9}) for name in ("one", "two")]])
    assert [row[0].text for row in comparison_document(few).tables[0].rows] == ["one", "two", "all 2"]


def test_markdown(compared: Comparison) -> None:
    text = markdown(compared)
    assert "| first | **0.500** (±0.010) | 0.600 (±0.010) | 2.000 (±0.010) |  |" in text
    assert "| second | **0.500** (±0.010) | **0.510** (±0.010) | 1.500 (±0.010) |  |" in text
    assert "| third | 0.700 (±0.010) | **0.600** (±0.010) | 1.000 (±0.010) | failed |" in text
    assert "| fourth | **0.400** (±0.010) |  | 0.900 (±0.010) |  |" in text
    assert "| first | 1.00 (±0.10) | 1.20 (±0.10) | 4.00 (±0.10) |  |" in text
    assert "- **mine**: in third: ValueError: matrix \\<3\\> is singular (step 12, 0.60 s, sensor roof_lidar" in text
    assert "1 of 2 met" in text


def test_json(compared: Comparison) -> None:
    found = json.loads(json.dumps(compared.json(), allow_nan=False))
    scores = {(score["scenario"], score["entrant"]["tracker"]): score for score in found["scores"]}
    assert scores["first", "fair"]["metrics"]["position_rmse"]["value"] == 0.6
    assert scores["second", "fair"]["leading"] is True
    assert scores["third", "mine"]["metrics"] == {}
    assert scores["third", "mine"]["failure"].startswith(REASON)
    assert [item["tracker"] for item in found["ranking"]] == ["good", "fair", "poor", "mine"]


def test_a_failed_tracker_is_not_compared_and_that_is_told() -> None:
    found = compare_results([scenario("third", {"good": 0.7, "fair": 0.6}, failed=True)])
    text = markdown(found)
    assert f"position_rmse not compared**: mine in results 1: {REASON}".replace("<", "\\<").replace(">", "\\>") in text
    assert len(found.not_compared) == 2

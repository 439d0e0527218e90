"""Several results of a scenario in order: where a change is shown, what else changed there, what becomes of limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from tests.support.past_results import SCENE, past

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.compare import Comparison
from trackbench.document import Figure, Row, Section
from trackbench.document.drawing import matplotlib_figure
from trackbench.report.comparison.document import comparison_document
from trackbench.report.comparison.over_time import first_shown
from trackbench.results import Result

Cli = Callable[..., Any]
NIGHTS = 7
#: The Kalman filter becomes worse by 20 % in the fifth of seven nights.
WORSE_AT = 4


@pytest.fixture(scope="module")
def nights() -> list[Result]:
    """Return seven nights on the same noise; the tracker's code changes a night before its error, a version with it."""
    return [
        past(
            night,
            {"raw": 0.2, "kf": 0.1 if night < WORSE_AT else 0.12},
            seed=1,
            version="0.8.0" if night < WORSE_AT else "0.9.0",
            code={"kf": "a" if night < WORSE_AT - 1 else "b"},
            commit="a" * 40 if night < WORSE_AT else "b" * 40,
        )
        for night in range(NIGHTS)
    ]


def marks(comparison: Comparison) -> list[tuple[str, int, str]]:
    return [(item.entrant.tracker, item.entrant.set, item.verdict) for item in first_shown(comparison.differences)]


def figures(comparison: Comparison) -> list[Figure]:
    sections = [block for block in comparison_document(comparison).blocks if isinstance(block, Section)]
    rows = [block for section in sections for block in section.blocks if isinstance(block, Row)]
    return [figure for row in rows for figure in row.blocks if isinstance(figure, Figure)]


def test_a_change_is_marked_where_it_is_with_what_changed_with_it(nights: list[Result]) -> None:
    comparison = tb.compare(*nights)
    assert marks(comparison) == [("kf", WORSE_AT, "worse")]
    changes = [origin.changes for origin in comparison.origins]
    assert changes[WORSE_AT - 1] == ["the code of kf"]
    assert changes[WORSE_AT] == ["trackbench 0.8.0 to 0.9.0", "commit aaaaaaaaaa to bbbbbbbbbb"]
    assert [number for number, texts in enumerate(changes) if texts] == [WORSE_AT - 1, WORSE_AT]
    assert [origin.made_at[:10] for origin in comparison.origins if origin.made_at] == [
        f"2026-01-0{day}" for day in range(1, NIGHTS + 1)
    ]
    text = " ".join(str(comparison).split())
    assert "First shown worse: kf E, where also changed: trackbench 0.8.0 to 0.9.0; commit aaaaaaaaaa" in text
    assert "E: 2026-01-05 00:00 UTC, commit bbbbbbbbbb: trackbench 0.8.0 to 0.9.0" in text


def test_a_change_back_is_not_marked_and_the_next_one_is() -> None:
    errors = [0.1, 0.1, 0.13, 0.13, 0.1, 0.13, 0.07]
    comparison = tb.compare(*(past(i, {"raw": 0.2, "kf": e}, seed=1) for i, e in enumerate(errors)))
    assert marks(comparison) == [("kf", 2, "worse"), ("kf", 5, "worse"), ("kf", 6, "better")]


def test_a_slow_drift_is_marked_once_it_is_more_than_the_margin() -> None:
    errors = [0.5 * 1.004**i for i in range(8)]
    ((name, number, verdict),) = marks(
        tb.compare(*(past(i, {"raw": 1.0, "kf": e}, seed=1) for i, e in enumerate(errors)))
    )
    assert (name, verdict) == ("kf", "worse")
    assert number > 1


def test_other_measurements_are_compared_unpaired() -> None:
    comparison = tb.compare(*(past(i, {"raw": 0.5, "kf": e}) for i, e in enumerate([0.1, 0.1, 0.2])))
    assert marks(comparison) == [("kf", 2, "worse")]
    assert {item.paired_runs for item in comparison.differences} == {None}


def test_without_a_change_few_courses_have_a_mark() -> None:
    marked = 0
    for number in range(20):
        results = [past(i, {"raw": 5.0, "kf": 4.0}, seed=100 * number + i, spread=0.8) for i in range(4)]
        marked += bool(marks(tb.compare(*results)))
    # Of 20 with a risk of at most 5 % each, five or more in 0.3 % of cases.
    assert marked < 5


def test_every_later_result_is_held_against_the_first(nights: list[Result], cli: Cli, tmp_path: Path) -> None:
    for number, result in enumerate(nights):
        result.save(tmp_path / "nights" / str(number) / result.name)
    folders = [f"nights/{number}" for number in range(NIGHTS)]
    limit = ("--fail-on-regression", "position_rmse:5")
    done = cli("compare", *folders, *limit, "--junit", "limits.xml", "--out", "nights.html")
    assert done.status == 1
    assert done.err.splitlines()[-1] == "3 of 12 limits broken: exit status 1 (0: all kept)"
    suites = ElementTree.parse(tmp_path / "limits.xml").getroot()
    assert [suite.get("failures") for suite in suites] == ["0", "0", "0", "1", "1", "1"]
    assert "<svg" in (tmp_path / "nights.html").read_text(encoding="utf-8")
    assert cli("compare", *folders[:WORSE_AT], *limit).status == 0
    assert cli("compare", *folders[WORSE_AT:], *limit).status == 0


def test_results_that_are_not_in_the_order_of_time_are_named(nights: list[Result]) -> None:
    comparison = tb.compare(nights[0], nights[3], nights[2])
    assert comparison.notes == ["results 3 was made before results 2, which is listed before it"]
    assert tb.compare(*nights).notes == []


def test_another_scene_under_the_same_name_is_refused(nights: list[Result]) -> None:
    text = SCENE.replace("position_sigma_m: 0.15", "position_sigma_m: 0.30")
    other = nights[2].updated(scenario=nights[2].summary.scenario.model_copy(update={"text": text}))
    with pytest.raises(InputError, match=r"sensors\.lidar\.position_sigma_m is 0\.3 here and 0\.15 there"):
        tb.compare(nights[0], nights[1], other)


def test_a_failed_tracker_has_a_gap_in_the_figure(nights: list[Result]) -> None:
    where = {"step": 1, "time_s": 0.1, "sensor": None, "run": None, "object": None}
    last = nights[2]
    trackers = [tracker.model_dump(mode="json") for tracker in last.summary.trackers]
    trackers[1]["failed"] = {"cause": "ValueError: no", **where}
    failed = Result.from_json({**last.json(), "trackers": trackers}, last.tables)
    comparison = tb.compare(*nights[:2], failed, nights[3], limits={"position_rmse": 5})
    outcomes = {(item.entrant.tracker, item.entrant.set): item.outcome for item in comparison.gates}
    assert [key for key, outcome in outcomes.items() if outcome != "passed"] == [("kf", 2)]
    assert outcomes["kf", 2] == "error"
    (figure,) = figures(comparison)
    (axes,) = matplotlib_figure(figure).axes
    (line,) = [line for line in axes.lines if line.get_gid() and any(value != value for value in line.get_ydata())]
    assert [value != value for value in line.get_ydata()] == [False, False, True, False]


def test_scenarios_that_another_metric_ranks_name_what_else_changed_too(nights: list[Result]) -> None:
    comparison = tb.compare(*nights)
    other = comparison.model_copy(update={"ranked_by": "tgospa", "origins": []})
    text = " ".join(str(tb.Comparison.model_validate({**dict(comparison), "other_groups": [other]})).split())
    assert text.count("First shown worse: kf E, where also changed: trackbench 0.8.0 to 0.9.0") == 2
    assert text.count("When they were made, and what else changed") == 1


def test_several_scenarios_have_one_origin_for_each_set(nights: list[Result]) -> None:
    def in_two_scenarios(result: Result) -> list[Result]:
        other = result.summary.scenario.model_copy(update={"name": "other"})
        return [result, result.updated(scenario=other)]

    comparison = tb.compare(*(in_two_scenarios(nights[number]) for number in (0, 1, WORSE_AT)))
    assert [len(origin.changes) for origin in comparison.origins] == [0, 0, 3]
    assert "what else changed" in str(comparison)

"""Results of a scenario over time: which changes are marked, what is said of them, and what becomes of limits."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.past_results import SCENE, past, scene

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.document import Figure, Paragraph, Row, Section, Status
from trackbench.results import Result
from trackbench.subjects.history.history import History
from trackbench.subjects.history.report import history_document

Cli = Callable[..., Any]
NIGHTS = 7
#: The Kalman filter becomes worse by 20 % in the fifth of seven nights.
WORSE_AT = 4


def keep(results: list[Result], folder: Path) -> Path:
    for number, result in enumerate(results, 1):
        result.save(folder / f"night-{number}" / result.name)
    return folder


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven nights on the same noise; with the change come a version and other code."""
    results = [
        past(
            night,
            {"raw": 0.2, "kf": 0.1 if night < WORSE_AT else 0.12},
            seed=1,
            version="0.8.0" if night < WORSE_AT else "0.9.0",
            code={"kf": "a" if night < WORSE_AT - 1 else "b"},
        )
        for night in range(NIGHTS)
    ]
    return keep(results, tmp_path_factory.mktemp("nights"))


@pytest.fixture(scope="module")
def gated(nights: Path) -> History:
    """The history of the nights with a limit over the last three before."""
    return tb.history(nights, limits={"position_rmse": 5}, window=3)


def test_a_change_is_marked_where_it_is_with_what_changed_with_it(gated: History) -> None:
    history = gated
    (change,) = history.changes
    assert (change.result, change.since, change.tracker, change.verdict) == (5, 1, "kf", "worse")
    assert change.percent == pytest.approx(20.0, abs=0.1)
    assert change.paired_runs == 20
    assert change.causes == ["trackbench 0.8.0 to 0.9.0", "the code of kf (at result 4)"]
    assert history.looks == 2 * (NIGHTS - 1)
    assert [entry.number for entry in history.results] == [*range(1, NIGHTS + 1)]


def test_the_page_begins_with_the_gate_and_what_has_changed(gated: History) -> None:
    history = gated
    gate, answer, row, changes, *_ = history_document(history).blocks
    assert gate == Status("1 of 2 limits kept, 1 broken", "bad")
    assert isinstance(answer, Paragraph)
    said = f"kf worse in result 5: position_rmse +{history.changes[0].difference:.4f} m (+20.0 "
    assert answer.text.startswith(said)
    assert isinstance(changes, Section)
    assert changes.title == "Changes"
    assert isinstance(row, Row)
    (figure,) = row.blocks
    assert isinstance(figure, Figure)
    assert figure.caption.endswith("change before.")


def test_results_are_in_the_order_in_which_they_were_made(tmp_path: Path) -> None:
    keep([past(day, {"raw": 0.2, "kf": 0.1}) for day in (3, 1, 2)], tmp_path)
    assert [Path(entry.folder).parts[-2] for entry in tb.history(tmp_path).results] == ["night-2", "night-3", "night-1"]


def test_a_change_back_is_marked_too(tmp_path: Path) -> None:
    errors = [0.1, 0.1, 0.13, 0.13, 0.1, 0.1]
    history = tb.history(keep([past(i, {"raw": 0.2, "kf": e}, seed=1) for i, e in enumerate(errors)], tmp_path))
    assert [(c.result, c.since, c.verdict) for c in history.changes] == [(3, 1, "worse"), (5, 3, "better")]


def test_a_slow_drift_is_marked_once_it_is_more_than_the_margin(tmp_path: Path) -> None:
    errors = [0.5 * 1.004**i for i in range(8)]
    history = tb.history(keep([past(i, {"raw": 1.0, "kf": e}, seed=1) for i, e in enumerate(errors)], tmp_path))
    assert history.changes
    assert all(change.result - change.since > 1 for change in history.changes)


def test_other_measurements_are_compared_unpaired(tmp_path: Path) -> None:
    errors = [0.1, 0.1, 0.2]
    history = tb.history(keep([past(i, {"raw": 0.5, "kf": e}) for i, e in enumerate(errors)], tmp_path))
    (change,) = history.changes
    assert (change.result, change.tracker, change.paired_runs) == (3, "kf", None)


def test_all_results_with_noise_of_their_own_are_one_sample(tmp_path: Path) -> None:
    results = [past(i, {"raw": 5.0, "kf": 4.0 if i < 3 else 6.0}, seed=min(i, 2)) for i in (0, 1, 1, 3)]
    (change,) = tb.history(keep(results, tmp_path / "all"), trackers=["kf"]).changes
    (alone,) = tb.history(keep(results[2:], tmp_path / "two"), trackers=["kf"]).changes
    errors = [result["kf"].position_rmse.value for result in results]
    # The third has the noise of the second, and adds nothing.
    assert (change.result, change.since, alone.reference) == (4, 1, errors[2])
    assert change.reference == pytest.approx(np.mean(errors[:2]))
    assert np.ptp(change.ci95) < np.ptp(alone.ci95)


def test_without_a_change_few_histories_have_a_mark(tmp_path: Path) -> None:
    marked = 0
    for number in range(20):
        results = [past(i, {"raw": 5.0, "kf": 4.0}, seed=100 * number + i, spread=0.8) for i in range(4)]
        folder = keep(results, tmp_path / str(number))
        marked += bool(tb.history(folder).changes)
    # Of 20 with a risk of at most 5 % each, five or more in 0.3 % of cases.
    assert marked < 5


def test_the_gate_holds_the_last_result_against_each_of_the_window(gated: History, nights: Path) -> None:
    wide, narrow = gated, tb.history(nights, limits={"position_rmse": 5}, window=2)
    outcomes = {gate.tracker: (gate.outcome, gate.against) for gate in wide.gates}
    assert outcomes == {"raw": ("passed", 6), "kf": ("failed", 4)}
    assert [gate.outcome for gate in narrow.gates] == ["passed", "passed"]
    assert (wide.passed, narrow.passed) == (False, True)


def test_a_tracker_that_is_gone_fails_the_gate(tmp_path: Path) -> None:
    keep([past(0, {"raw": 0.2, "kf": 0.1}), tb.run(tb.load(SCENE, trackers=["raw"]))], tmp_path)
    gates = tb.history(tmp_path, limits={"position_rmse": 5}).gates
    assert [(gate.tracker, gate.outcome) for gate in gates if gate.tracker == "kf"] == [("kf", "error")]


def test_a_single_result_has_nothing_to_be_held_against(tmp_path: Path) -> None:
    history = tb.history(keep([past(0, {"raw": 0.2, "kf": 0.1})], tmp_path), limits={"position_rmse": 5})
    assert {gate.text for gate in history.gates} == {"there is no result before it"}
    assert "0 of 2 limits kept, 2 undecided" in str(history)
    assert not history.passed
    assert "No change is shown" in str(history)


def test_another_scene_under_the_same_name_begins_anew(tmp_path: Path) -> None:
    results = [past(i, {"raw": 0.2, "kf": 0.1 if i < 2 else 0.2}, seed=1) for i in range(4)]
    for number in (2, 3):
        stated = results[number].summary.scenario
        text = SCENE.replace("position_sigma_m: 0.15", "position_sigma_m: 0.30")
        results[number] = results[number].updated(scenario=stated.model_copy(update={"text": text}))
    history = tb.history(keep(results, tmp_path), limits={"position_rmse": 5}, window=2)
    assert history.changes == []
    (broken,) = history.breaks
    assert (broken.result, broken.since, broken.trackers) == (3, 1, ["raw", "kf"])
    assert "sensors.lidar.position_sigma_m is 0.3 here and 0.15 there" in broken.reason
    assert {gate.outcome for gate in history.gates} == {"passed"}


def test_a_failed_tracker_has_no_value_and_the_gate_is_an_error(tmp_path: Path) -> None:
    first, last = (past(i, {"raw": 0.2, "kf": 0.1}, seed=1) for i in range(2))
    where = {"step": 1, "time_s": 0.1, "sensor": None, "run": None, "object": None}
    trackers = [tracker.model_dump(mode="json") for tracker in last.summary.trackers]
    trackers[1]["failed"] = {"cause": "ValueError: no", **where}
    keep([first, Result.from_json({**last.json(), "trackers": trackers}, last.tables)], tmp_path)
    history = tb.history(tmp_path, limits={"position_rmse": 5})
    assert history.results[1].failures["kf"].startswith("ValueError: no")
    assert [gate.outcome for gate in history.gates] == ["passed", "error"]
    assert "ValueError: no" in history.gates[1].text
    assert "n/a" in str(history)


def test_results_of_other_scenarios_and_without_a_time_are_named_in_a_line_each(tmp_path: Path) -> None:
    results = [past(i, {"raw": 0.2, "kf": 0.1}) for i in range(3)]
    results[1] = results[1].updated(provenance=None)
    other = results[2].updated(scenario=results[2].summary.scenario.model_copy(update={"name": "other"}))
    history = tb.history(keep([*results, other], tmp_path))
    assert history.results[0].made_at is None
    assert history.notes == [
        "1 result of other scenarios left out: other (1); --scenario NAME shows those of another",
        "1 result of an earlier version, without a time: placed first, in the order found",
    ]
    assert [entry.folder.split("/")[-1] for entry in tb.history(tmp_path, scenario="other").results] == ["other"]


def test_a_folder_that_is_named_twice_counts_once(nights: Path) -> None:
    assert len(tb.history([nights, nights, nights / "night-1"]).results) == NIGHTS


def test_the_command_prints_writes_and_gates(nights: Path, cli: Cli, tmp_path: Path) -> None:
    done = cli("history", nights, "--gate", "position_rmse:5%", "--out", "page", "--junit", "gates.xml")
    assert done.status == 1
    assert max(map(len, done.out.splitlines())) <= 80
    assert "worse" in done.out
    line = "1 of 2 limits kept, 1 broken: exit status 1 (0: all shown kept)"
    assert done.err.splitlines() == ["page/: history.html, history.md, history.json", line]
    assert re.search(r'tests="2" failures="1"', (tmp_path / "gates.xml").read_text(encoding="utf-8"))
    assert (tmp_path / "page" / "figures" / "history-position_rmse.svg").is_file()
    kept = json.loads((tmp_path / "page" / "history.json").read_text(encoding="utf-8"))
    shown = cli("history", nights, "--gate", "position_rmse:5", "--json")
    assert json.loads(shown.out) == kept
    assert kept["passed"] is False
    page = (tmp_path / "page" / "history.html").read_text(encoding="utf-8")
    assert "<svg" in page
    # A kept history is shown again, by its folder or its file.
    for place, folder in (("page", "again"), ("page/history.json", "once_more")):
        assert cli("report", place, "--format", "html", "--out", folder).status == 0
        assert (tmp_path / folder / "history.html").read_text(encoding="utf-8") == page
    assert cli("report", "page").out == done.out
    (tmp_path / "page" / "history.json").write_text(json.dumps({**kept, "looks": "many"}), encoding="utf-8")
    damaged = cli("report", "page")
    assert (damaged.status, len(damaged.err.splitlines())) == (2, 1)
    assert "page/history.json: not a history: looks: " in damaged.err
    assert cli("history", nights).status == 0


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["nowhere"], "nowhere: there is no such folder"),
        (["empty"], "empty: no result.json in this folder, nor in the folders in it"),
        (["nights", "--scenario", "scen"], "--scenario: no result of the scenario 'scen'; did you mean 'scene'?"),
        (["nights", "--metric", "position_rms"], "--metric: 'position_rms' has no value in each run; did you mean"),
        (["nights", "--trackers", "kff"], "--trackers: no tracker 'kff' in these results; did you mean 'kf'?"),
        (["nights", "--gate", "position_rmse"], "--gate: write METRIC:PERCENT"),
        (["nights", "--gate", "position_rms:5"], "--gate: 'position_rms' has no value in each run"),
        (["nights", "--gate", "position_rmse:-5"], "--gate: '-5' is no percentage"),
        (["nights", "--gate", "nees.mean:5"], "--gate: neither a larger nor a smaller nees.mean is better"),
        (["nights", "--junit", "x.xml"], "--junit: says which limits are kept: give --gate too"),
        (["damaged"], "damaged/result.json: not a readable result"),
    ],
)
def test_bad_input_gives_one_clear_line(
    nights: Path, cli: Cli, tmp_path: Path, arguments: list[str], problem: str
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "result.json").write_text("{", encoding="utf-8")
    (tmp_path / "nights").symlink_to(nights)
    done = cli("history", *arguments)
    assert done.status == 2
    assert problem in done.err
    assert len(done.err.splitlines()) == 1


def test_a_single_run_can_show_no_regression(tmp_path: Path) -> None:
    single = tb.run(SCENE.replace("runs: 20", "runs: 1"))
    single.save(tmp_path / "one")
    with pytest.raises(InputError, match="no regression can be shown: "):
        tb.history(tmp_path, limits={"position_rmse": 5})


def test_a_data_frame_has_a_row_for_each_value(nights: Path) -> None:
    table = tb.history(nights, metrics=["position_rmse", "velocity_rmse"]).to_pandas()
    assert len(table) == NIGHTS * 4 - (scene()["raw"].velocity_rmse.value is None) * NIGHTS
    assert str(table["made_at"].dtype).startswith("datetime64")

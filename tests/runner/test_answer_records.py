"""What a tracker says in every run, kept and scored again by ``use: tracks``: the same to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.runner.run import run_scenario
from trackbench.scenario.truth import truths_of


def kept(name: str, tracker: str) -> tuple[tb.Result, pd.DataFrame]:
    loaded = tb.load(name, {"expect": []}, runs=2, trackers=[tracker])
    result = run_scenario(loaded, truths_of(loaded), keeps_answers=True)
    return result, result.tables["answers"].to_pandas().drop(columns="tracker")


def scored(name: str, rows: pd.DataFrame, file: Path) -> tb.Result:
    rows.to_parquet(file)
    return tb.run(tb.load(name, {"expect": [], "trackers": {"theirs": {"use": "tracks", "path": str(file)}}}, runs=2))


@pytest.mark.parametrize(("name", "tracker"), [("recorded/i80", "ekf_cv"), ("recorded/i80_hidden", "jpda")])
def test_the_scores_come_again(name: str, tracker: str, tmp_path: Path) -> None:
    own, rows = kept(name, tracker)
    theirs, ours = scored(name, rows, tmp_path / "rows.parquet")["theirs"].metrics, own[tracker].metrics
    # A file has no innovations, no times and no associations.
    same = [path for path in ours if not path.startswith(("nis", "whiteness", "step_time", "association"))]
    assert ours["position_rmse"].value > 0.1
    assert {path: theirs[path].value for path in same} == {path: ours[path].value for path in same}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"object": "aheat"}, "there is no object 'aheat'; did you mean 'ahead'?"),
        ({"time_s": 0.0137}, "there is no scan at 0.0137 s, where an estimate is given"),
        ({"p_00": None}, "each row needs a covariance: p_00 to p_33"),
        ({"fingerprint": "0"}, "they were made of other scans"),
    ],
)
def test_what_is_no_estimate_of_a_known_object_is_refused(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    _, rows = kept("scripted/own_model", "ekf")
    with pytest.raises(InputError, match="scene 0, run ") as caught:
        scored("scripted/own_model", rows[:1].assign(**change), tmp_path / "rows.parquet")
    assert message in str(caught.value)

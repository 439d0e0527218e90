"""``trackbench score``: files of other programs against boxes, as a user types it, and against TrackEval."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
from tests.support.trackeval_scores import RATE, as_kitti, as_motchallenge, by_trackeval, drawn

import trackbench as tb


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning:trackeval")
@pytest.mark.parametrize(("form", "write"), [("motchallenge", as_motchallenge), ("kitti", as_kitti)])
def test_files_of_benchmarks_score_as_in_trackeval(form: str, write: Callable[..., None], tmp_path: Path) -> None:
    truth, tracks = drawn(4)
    write(truth, tmp_path / "gt.txt")
    write(tracks, tmp_path / "tracks.txt")
    result = tb.score(tmp_path / "tracks.txt", tmp_path / "gt.txt", format=form, rate_hz=RATE)["tracks"]
    theirs = by_trackeval([(truth, tracks)])
    assert 0.2 < theirs["HOTA"] < 0.8
    ours = {name: result.metrics[name.lower()].value for name in theirs}
    assert ours == pytest.approx(theirs, abs=1e-9)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Boxes of three cars, tracks that are 0.3 m to one side, and such that also miss one car."""
    truth, _ = drawn(0)
    boxes = pd.DataFrame({"timestamp_ns": 1_700_000_000_000_000_000 + truth.frame * 100_000_000})
    boxes = boxes.assign(object_id=truth.id, pos_x=691_000 + truth.x, pos_y=5_300_000 + truth.y)
    boxes.to_csv(tmp_path / "boxes.csv", index=False)
    tracks = boxes.rename(columns={"object_id": "track_id"}).assign(pos_y=boxes.pos_y + 0.3)
    tracks.to_csv(tmp_path / "old.csv", index=False)
    tracks[tracks.track_id > 1].to_parquet(tmp_path / "new.parquet")
    return tmp_path


@pytest.mark.usefixtures("pages")
def test_a_command_without_a_scenario(files: Path, cli: Callable[..., Any]) -> None:
    done = cli("score", "old.csv", "new.parquet", "--truth", "boxes.csv", "--json", "--no-recording")
    assert done.status == 0
    trackers = {item["name"]: item for item in json.loads(done.out)["trackers"]}
    # Three cars 0.3 m off; two so and one missed, which costs half of the squared cutoff.
    assert trackers["old"]["metrics"]["gospa"]["value"] == pytest.approx(np.sqrt(3 * 0.09), rel=1e-6)
    assert trackers["new"]["metrics"]["gospa"]["value"] == pytest.approx(np.sqrt(2 * 0.09 + 12.5), rel=1e-6)
    assert all(item["offline"] for item in trackers.values())
    # The scenario that it is gives the same.
    again = cli("run", "results/boxes.yaml", "--json", "--no-recording", "--out", "again")
    assert json.loads(again.out)["ranking"] == ["old", "new"]


def test_files_that_call_a_column_differently(files: Path, cli: Callable[..., Any]) -> None:
    old = pd.read_csv(files / "old.csv").rename(columns={"pos_x": "fx"})
    old.to_csv(files / "other.csv", index=False)
    maps = ["--map", "x=fx", "--map", "x=pos_x"]
    done = cli("score", "other.csv", "--truth", "boxes.csv", *maps, "--json", "--no-recording")
    (tracker,) = json.loads(done.out)["trackers"]
    assert tracker["metrics"]["gospa"]["value"] == pytest.approx(np.sqrt(3 * 0.09), rel=1e-6)


@pytest.mark.parametrize(
    ("gates", "status", "failed"),
    [(["gospa:0.6"], 1, ["new"]), (["gospa:2%"], 1, ["new"]), (["gospa:4", "hota:0.1", "mota:60%"], 0, [])],
)
def test_gates(files: Path, cli: Callable[..., Any], gates: list[str], status: int, failed: list[str]) -> None:
    limits = [text for gate in gates for text in ("--gate", gate)]
    arguments = ["--truth", "boxes.csv", *limits, "--junit", "gates.xml", "--no-recording"]
    done = cli("score", "old.csv", "new.parquet", *arguments)
    assert done.status == status
    suite = ET.parse(files / "gates.xml").getroot()
    names = [
        case.attrib["name"].partition(":")[0] for case in suite.iter("testcase") if case.find("failure") is not None
    ]
    assert names == failed


def test_gates_stand_in_the_json(files: Path, cli: Callable[..., Any]) -> None:
    gates = ["--gate", "gospa:0.6", "--gate", "gospa:2%"]
    done = cli("score", "old.csv", "new.parquet", "--truth", "boxes.csv", *gates, "--json", "--no-recording")
    result = json.loads(done.out)
    assert (done.status, result["passed"]) == (1, False)
    one, other, relative = result["gates"]
    values = {item["name"]: item["metrics"]["gospa"] for item in result["trackers"]}
    for gate in (one, other, relative):
        assert {key: gate[key] for key in ("value", "unit", "ci95")} == {
            key: values[gate["tracker"]].get(key) for key in ("value", "unit", "ci95")
        }
    assert [(gate["tracker"], gate["metric"], gate["passed"]) for gate in (one, other, relative)] == [
        ("old", "gospa", True),
        ("new", "gospa", False),
        ("new", "gospa", False),
    ]
    assert one["limit"] == 0.6
    assert relative["text"].endswith("by more than 2 %")
    assert relative["limit"] == pytest.approx(1.02 * values["old"]["value"], rel=1e-12)
    # An expectation beside the gates counts too, and a metric without a value fails its gate.
    set_to = ["--set", "expect=[{tracker: old, metric: gospa, below: 0.1}]"]
    done = cli("score", "old.csv", "--truth", "boxes.csv", *gates[:2], *set_to, "--json", "--no-recording")
    result = json.loads(done.out)
    assert (done.status, result["passed"], result["gates"][0]["passed"]) == (1, False, True)
    done = cli("score", "old.csv", "--truth", "boxes.csv", "--gate", "velocity_rmse:4", "--json", "--no-recording")
    (gate,) = json.loads(done.out)["gates"]
    assert (done.status, gate["value"], gate["passed"]) == (1, None, False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv"], "there is no such file"),
        (["old.csv", "--map", "x"], "write KEY=COLUMN"),
        (["old.csv", "--map", "xx=pos_x"], "no column is called 'xx'; did you mean 'x'?"),
        (["old.csv", "--map", "x=posx"], "no file has a column 'posx'; did you mean 'pos_x'?"),
        (["old.csv", "--map", "time=timestamp_ns:min"], "'min' after column 'timestamp_ns' is no unit"),
        (["two.csv", "--map", "x=px", "--map", "x=pos_x"], "x is mapped to 'px' and 'pos_x', and this file has both"),
        (["two.csv"], "x may be 'pos_x' or 'px'; say which"),
        (["old.csv", "--gate", "gospa:2%"], "2 % of what?"),
        (["old.csv", "--gate", "gopsa:2"], "no metric 'gopsa'; did you mean 'gospa'?"),
        (["old.csv", "--gate", "nees:2"], "neither a larger nor a smaller nees is better"),
        (["mot.txt"], "does not tell the format"),
        (["mot.txt", "--format", "mot"], "no format 'mot'"),
        (["old.csv", "--truth-format", "cvs"], "--truth-format: no format 'cvs'; did you mean 'csv'?"),
        (["mot.txt", "--format", "motchallenge"], "give their number per second, --rate"),
        (["picture.txt", "--format", "motchallenge", "--rate", "10"], "these are boxes in the picture"),
        (["empty.csv"], "the file is empty"),
    ],
)
def test_mistakes_are_one_line(files: Path, cli: Callable[..., Any], arguments: list[str], message: str) -> None:
    tracks = pd.read_csv(files / "old.csv")
    tracks.assign(px=0).to_csv(files / "two.csv", index=False)
    as_motchallenge(drawn(0)[0], files / "mot.txt")
    (files / "picture.txt").write_text("1,1,5,6,7,8,1,-1,-1,-1\n")
    (files / "empty.csv").write_text("")
    done = cli("score", "--truth", "boxes.csv", "--truth-format", "csv", *arguments)
    assert done.status == 2
    assert message in done.err.splitlines()[-1]
    assert not (files / "results" / "boxes").exists()

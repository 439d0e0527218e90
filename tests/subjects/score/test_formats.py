"""The format that is stated wins over the ending of a file, for tracks and for boxes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from tests.support.ros_bags import Body, Messages, write_bag
from tests.support.traffic_files import OPTIONS, WRITERS

import trackbench as tb

Cli = Callable[..., Any]
FORMATS = ("csv", "parquet", "kitti", "motchallenge", "commonroad")
ENDINGS = (".csv", ".parquet", ".txt", ".mcap", "")
TIMES = [k / 10 for k in range(30)]


@pytest.fixture
def boxes(tmp_path: Path) -> Path:
    file = tmp_path / "boxes.csv"
    pd.DataFrame({"time": TIMES, "id": 1, "x": range(30), "y": 0}).to_csv(file, index=False)
    return file


@pytest.mark.parametrize("form", FORMATS)
def test_a_stated_format_wins_over_the_ending(form: str, tmp_path: Path) -> None:
    boxes = WRITERS["csv"](tmp_path)
    (tmp_path / "written").mkdir()
    written = WRITERS[form](tmp_path / "written")
    files = [Path(shutil.copy(written, tmp_path / f"tracks{ending or '_none'}")) for ending in ENDINGS]
    rate = OPTIONS.get(form, {}).get("rate_hz")
    result = tb.score(files, boxes, format=form, truth_format="csv", rate_hz=rate)
    values = [tracker.metrics["gospa"].value for tracker in result.summary.trackers]
    assert values == [pytest.approx(0, abs=1e-9)] * len(ENDINGS)
    # As boxes, and as a scenario says it.
    for file in files[-1:]:
        theirs = {"use": "tracks", "path": file.name, "format": form, **OPTIONS.get(form, {})}
        again = tb.score(boxes, file, format="auto", truth_format=form, rate_hz=rate)
        assert again["cars"].metrics["gospa"].value == pytest.approx(0, abs=1e-9)
        scenario = {
            "name": "stated",
            "truth": {"source": "recorded-boxes", "path": file.name, "format": form, **OPTIONS.get(form, {})},
            "sensing": {"identities": "hidden"},
            "trackers": {"theirs": theirs},
            "monte_carlo": {"runs": 1},
        }
        (tmp_path / "stated.yaml").write_text(yaml.safe_dump(scenario))
        assert tb.run(tmp_path / "stated.yaml")["theirs"].metrics["gospa"].value == pytest.approx(0, abs=1e-9)


def test_a_bag_of_ros_2_in_mcap_is_a_file_or_a_folder(tmp_path: Path, boxes: Path, cli: Cli) -> None:
    pytest.importorskip("rosbags", reason="needs trackbench[ros]")
    messages = Messages()
    bodies = [[Body(state=(k, 0.0, 0.0, 10.0))] for k in range(30)]
    sent = [("/objects", messages.tracked(time, bodies=own)) for time, own in zip(TIMES, bodies, strict=True)]
    for mcap in (True, False):
        file = write_bag(tmp_path, sent, mcap=mcap, name=f"bag{mcap:d}")
        shutil.copy(file, tmp_path / f"alone{mcap:d}{file.suffix}")
        for tracks in (file.parent, Path(f"alone{mcap:d}{file.suffix}")):
            done = cli(
                "score",
                tracks,
                "--truth",
                boxes,
                "--format",
                "ros",
                "--truth-format",
                "csv",
                "--json",
                "--no-recording",
            )
            assert done.status == 0, done.err
            (tracker,) = json.loads(done.out)["trackers"]
            assert tracker["metrics"]["gospa"]["value"] == pytest.approx(0, abs=1e-6)
        # As boxes too, and the scenario that it is runs.
        done = cli("score", boxes, "--truth", file, "--truth-format", "ros", "--no-recording", "--out", "turned")
        assert done.status == 0, done.err
        written = tmp_path / "turned" / f"{file.stem}.yaml"
        assert cli("run", written, "--no-recording", "--out", "again").status == 0
    # What the ending says is of another kind of MCAP.
    done = cli("score", "alone1.mcap", "--truth", boxes)
    assert done.status == 2
    assert "format ros reads bags of ROS 2" in done.err
    (tmp_path / "empty").mkdir()
    assert "ends in .bag, .db3" in cli("score", "empty", "--truth", boxes, "--format", "ros").err
    # Of a stated format are all files of a folder where none has an ending of it.
    for name in ("tracks/a", "truth/a"):
        (tmp_path / name).parent.mkdir()
    shutil.copy(tmp_path / "alone1.mcap", tmp_path / "tracks" / "a.mcap")
    shutil.copy(boxes, tmp_path / "truth" / "a.csv")
    folders = ("tracks", "--truth", "truth", "--format", "ros", "--truth-format", "csv")
    done = cli("score", *folders, "--json", "--no-recording")
    assert done.status == 0, done.err
    (tracker,) = json.loads(done.out)["trackers"]
    assert tracker["metrics"]["gospa"]["value"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("classes", ["car", "CAR"])
def test_kitti_has_its_own_spelling_of_classes(classes: str, tmp_path: Path, cli: Cli) -> None:
    names = ("Car", "Van", "Truck", "Pedestrian", "Person_sitting", "Cyclist", "Tram", "Misc")
    line = "{k} {n} {name} 0 0 0 1 2 3 4 1.5 1.8 4.5 {y} 1.5 {k} 0\n"
    every = [line.format(k=k, n=n, name=name, y=20 * n) for k in range(30) for n, name in enumerate(names)]
    (tmp_path / "labels.txt").write_text("".join(every))
    (tmp_path / "cars.txt").write_text("".join(text for text in every if " Car " in text))
    # Without a filter seven of eight objects are missed.
    for reference, matched in (
        ({}, 1 / 8),
        ({"classes": [classes]}, 1.0),
        ({"classes": [classes, "Person_Sitting"]}, 0.5),
    ):
        arguments = [
            "--format",
            "kitti",
            "--json",
            "--no-recording",
            "--set",
            f"truth.reference={json.dumps(reference)}",
        ]
        done = cli("score", "cars.txt", "--truth", "labels.txt", *arguments)
        assert done.status == 0, done.err
        (tracker,) = json.loads(done.out)["trackers"]
        assert tracker["metrics"]["matched_share"]["value"] == pytest.approx(matched)
    done = cli(
        "score", "cars.txt", "--truth", "labels.txt", "--format", "kitti", "--set", "truth.reference.classes=[Bus]"
    )
    assert done.status == 2
    assert "no object is of the class 'Bus'; the file has car, cyclist" in done.err

"""Tracks for other tools."""

from __future__ import annotations

import configparser
import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trackeval.datasets import MotChallenge2DBox
from trackeval.metrics import CLEAR

from trackbench.metrics.track_events import events_of
from trackbench.results import Result

QUIET = {"PRINT_CONFIG": False}


@pytest.fixture
def exported(cli: Callable[..., Any], traffic_folder: Path, tmp_path: Path) -> Path:
    done = cli("report", traffic_folder, "--format", "mot", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert done.out.endswith("out/: 6 files in mot/\n")
    return tmp_path / "out" / "mot"


def read(folder: Path) -> MotChallenge2DBox:
    return MotChallenge2DBox(
        {
            **QUIET,
            "GT_FOLDER": str(folder / "gt"),
            "TRACKERS_FOLDER": str(folder / "trackers"),
            "OUTPUT_FOLDER": str(folder / "scores"),
            "BENCHMARK": "MOT17",
            "SEQ_INFO": {"three_cars": None},
            "SKIP_SPLIT_FOL": True,
        }
    )


def test_trackeval_reads_it(exported: Path, traffic_result: Result) -> None:
    dataset = read(exported)
    due, tracks = traffic_result.to_pandas("due"), traffic_result.to_pandas("tracks")
    assert sorted(dataset.tracker_list) == ["gnn", "naive", "oracle", "pmb"]
    for tracker in dataset.tracker_list:
        raw = dataset.get_raw_seq_data(tracker, "three_cars")
        data = dataset.get_preprocessed_seq_data(raw, "pedestrian")
        own = tracks[tracks["tracker"] == tracker]
        assert sum(map(len, raw["tracker_ids"])) == len(own)
        assert data["num_timesteps"] == due["time_s"].nunique() == 61
        assert data["num_gt_dets"] == (due["status"] == 2).sum()
        assert data["num_gt_ids"] == 3
        clear = CLEAR(QUIET).eval_sequence(data)
        # Its boxes overlap by half where ours are a cutoff apart along an axis, and less far apart else.
        share = traffic_result[tracker].metrics["matched_share"].value
        assert share is not None
        assert clear["CLR_Re"] == pytest.approx(share, abs=0.1)
        assert clear["CLR_Re"] > 0.5


def test_boxes_a_cutoff_apart_overlap_by_half(exported: Path) -> None:
    row = [float(value) for value in (exported / "gt/three_cars/gt/gt.txt").read_text().splitlines()[0].split(",")]
    left, top, width, height = row[2:6]
    assert (left + width / 2, top + height / 2) == pytest.approx((20, -4))
    both = (width - 5) * height
    assert both / (2 * width * height - both) == 0.5


def test_a_track_on_an_optional_object_does_not_count_there(exported: Path, traffic_result: Result) -> None:
    rows = np.loadtxt(exported / "gt/three_cars/gt/gt.txt", delimiter=",")
    status = traffic_result.to_pandas("due")["status"]
    assert set(rows[:, 7]) == {1, 8}
    assert (rows[:, 7] == 8).sum() == (status == 1).sum()
    assert (rows[rows[:, 7] == 8, 6] == 0).all()


def test_the_sequence_says_its_rate(exported: Path) -> None:
    file = configparser.ConfigParser()
    file.read(exported / "gt/three_cars/seqinfo.ini")
    assert dict(file["Sequence"]) == {"name": "three_cars", "framerate": "10", "seqlength": "61"}


def test_events_as_csv(cli: Callable[..., Any], traffic_folder: Path, tmp_path: Path, traffic_result: Result) -> None:
    done = cli("report", traffic_folder, "--format", "events", "--out", tmp_path)
    assert done.status == 0
    with (tmp_path / "events.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(events_of(traffic_result))
    dearest = max(rows, key=lambda row: float(row["cost_m2"]))
    assert float(dearest["cost_m2"]) == events_of(traffic_result)[0].cost_m2


def test_labelled_runs_have_none(cli: Callable[..., Any], tiny: Path) -> None:
    assert cli("run", tiny, "--no-recording").status == 0
    for format in ("mot", "events"):
        done = cli("report", "results/tiny", "--format", format)
        assert done.status == 2
        assert done.err == f"--format: {format} is written of runs with hidden identities alone\n"

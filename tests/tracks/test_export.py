"""Tracks for other tools."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trackeval.datasets import MotChallenge2DBox
from trackeval.metrics import CLEAR

from trackbench.results import Result

QUIET = {"PRINT_CONFIG": False}


@pytest.fixture
def exported(cli: Callable[..., Any], traffic_folder: Path, tmp_path: Path) -> Path:
    done = cli("report", traffic_folder, "--format", "mot", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert done.out.endswith("out/: 6 files in mot/\n")
    return tmp_path / "out" / "mot"


def read(folder: Path, name: str = "three_cars") -> MotChallenge2DBox:
    return MotChallenge2DBox(
        {
            **QUIET,
            "GT_FOLDER": str(folder / "gt"),
            "TRACKERS_FOLDER": str(folder / "trackers"),
            "OUTPUT_FOLDER": str(folder / "scores"),
            "BENCHMARK": "MOT17",
            "SEQ_INFO": {name: None},
            "SKIP_SPLIT_FOL": True,
        }
    )


def data_of(dataset: MotChallenge2DBox, tracker: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = dataset.get_preprocessed_seq_data(dataset.get_raw_seq_data(tracker, name), "pedestrian")
    return found


def of_recorded_run(result: Result, tracker: str, metric: str) -> float:
    runs = result.to_pandas("runs")
    row = runs[(runs["tracker"] == tracker) & (runs["run"] == result.summary.recorded_run)].iloc[0]
    return float(row[f"{metric}_total"] / row[f"{metric}_count"])


def test_trackeval_reads_it(exported: Path, traffic_result: Result) -> None:
    dataset = read(exported)
    due, tracks = traffic_result.to_pandas("due"), traffic_result.to_pandas("tracks")
    assert sorted(dataset.tracker_list) == ["gnn", "naive", "oracle", "pmb"]
    for tracker in dataset.tracker_list:
        data = data_of(dataset, tracker, "three_cars")
        own = tracks[tracks["tracker"] == tracker]
        assert sum(map(len, dataset.get_raw_seq_data(tracker, "three_cars")["tracker_ids"])) == len(own)
        assert data["num_timesteps"] == due["time_s"].nunique() == 61
        assert data["num_gt_dets"] == (due["status"] == 2).sum()
        assert data["num_gt_ids"] == 3
        mota = of_recorded_run(traffic_result, tracker, "mota")
        assert CLEAR(QUIET).eval_sequence(data)["MOTA"] == pytest.approx(mota, abs=0.01)


def test_boxes_half_a_cutoff_apart_overlap_by_half(exported: Path, traffic_result: Result) -> None:
    row = [float(value) for value in (exported / "gt/three_cars/gt/gt.txt").read_text().splitlines()[0].split(",")]
    left, top, width, height = row[2:6]
    assert (left + width / 2, top + height / 2) == pytest.approx((20, -4))
    cutoff = traffic_result.summary.score.cutoff_m
    assert cutoff is not None
    both = (width - cutoff / 2) * height
    assert both / (2 * width * height - both) == 0.5


def test_a_track_on_an_optional_object_does_not_count_there(exported: Path, traffic_result: Result) -> None:
    rows = np.loadtxt(exported / "gt/three_cars/gt/gt.txt", delimiter=",")
    status = traffic_result.to_pandas("due")["status"]
    assert set(rows[:, 7]) == {1, 8}
    assert (rows[:, 7] == 8).sum() == (status == 1).sum()
    assert (rows[rows[:, 7] == 8, 6] == 0).all()

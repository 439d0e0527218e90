"""The gates of the recorded run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.path import Path as Outline

from trackbench.base.types import Scan
from trackbench.results import Result
from trackbench.runner.traffic_tables import CORNERS, outlines


def test_the_edge_is_where_the_distance_is_the_threshold() -> None:
    noise, turn = np.diag([0.04, 0.09]), 0.3
    pose = np.array([1.0, 2.0, turn])
    scan = Scan(0.0, "lidar", "lidar", np.zeros((2, 0)), np.zeros(0, bool), noise, pose, np.zeros(2), 0.0)
    mean = np.array([[10.0, -4.0], [5.0, 8.0], [1.0, 0.0], [0.0, 2.0]])
    covariance = np.stack([np.diag([1.0, 2.0, 1.0, 1.0]), np.diag([3.0, 0.5, 1.0, 1.0])], axis=2)
    x, y = outlines(scan, mean, covariance, 9.0)
    assert x.shape == y.shape == (2, CORNERS)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for track in range(2):
        spread = covariance[:2, :2, track] + rotation @ noise @ rotation.T
        away = np.stack([x[track], y[track]]) - mean[:2, track, None]
        np.testing.assert_allclose(np.einsum("ic,ij,jc->c", away, np.linalg.inv(spread), away), 9.0)


@pytest.mark.parametrize("tracker", ["gnn", "naive"])
def test_a_detection_that_was_taken_is_in_its_gate(traffic_result: Result, tracker: str) -> None:
    gates, taken = (traffic_result.to_pandas(name) for name in ("gates", "taken"))
    edges = {key: rows[["x_m", "y_m"]].to_numpy() for key, rows in _own(gates, tracker).groupby(["scan", "track"])}
    rows = traffic_result.to_pandas("measurements").itertuples()
    detections = {(row.scan, row.detection): (row.x_m, row.y_m) for row in rows}
    found = [
        Outline(edges[row.scan, row.track]).contains_point(detections[row.scan, row.detection])
        for row in _own(taken, tracker).itertuples()
        if (row.scan, row.track) in edges
    ]
    assert len(found) > 50
    # The corners cut off a fiftieth of the gate's reach.
    assert np.mean(found) > 0.99


def test_one_that_knows_the_origins_has_no_gate(traffic_result: Result) -> None:
    assert set(traffic_result.to_pandas("gates")["tracker"]) == {"gnn", "pmb", "naive"}


def _own(table: Any, tracker: str) -> Any:
    return table[table["tracker"] == tracker]

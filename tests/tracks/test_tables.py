"""What a run of hidden identities leaves in its tables, the gates of the recorded run among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.types import Scan
from trackbench.metrics.function_events import events_of
from trackbench.metrics.traffic import timeline
from trackbench.results import Result
from trackbench.runner.track_records import CORNERS, gate_outlines

STATE = {"px_m", "py_m", "vx_mps", "vy_mps", *(f"p_{a}{b}" for a in range(4) for b in range(a, 4))}
MEASUREMENT = {"z0", "z1", "z2", "x_m", "y_m", "sensor_x_m", "sensor_y_m", "sensor_yaw_rad"}
#: What each table has at least; without functions, and of one scene.
TABLES = {
    "truth": {"object", "role", "time_s", "alive", "px_m", "heading_rad", "speed_mps", "yaw_rate_radps", "length_m"},
    "roads": {"line", "x_m", "y_m"},
    "differences": {"a", "b", "metric", "unit", "better", "verdict", "value", "ci95_low", "margin", "p_value"},
    "steps": {
        *("tracker", "time_s", "gospa_m", "gospa_localisation_m", "gospa_missed_m", "gospa_false_m"),
        "recorded_gospa_m",
    },
    "runs": {"tracker", "run", "scene", "count"},
    "measurements": {"sensor", "kind", "object", "scan", "detection", "time_s", "valid", *MEASUREMENT},
    "tracks": {"tracker", "time_s", "track", "existence", *STATE},
    "taken": {"tracker", "time_s", "scan", "track", "detection"},
    "gates": {"tracker", "time_s", "scan", "track", "x_m", "y_m"},
    "events": {"tracker", "kind", "object", "other_object", "why", "run", "time_s", "track", "other_track", "cost_m2"},
    "objects": {"tracker", "object", "state", "time_s", "until_s"},
    "due": {"object", "time_s", "status"},
}


def test_every_table_is_as_stated(traffic_result: Result) -> None:
    assert set(traffic_result.tables) == set(TABLES)
    for name, columns in TABLES.items():
        assert columns <= set(traffic_result.tables[name].column_names), name


def test_the_costs_of_the_events_are_all_that_is_missed_and_false(traffic_result: Result) -> None:
    steps = len(np.unique(traffic_result.tables.due["time_s"].to_numpy()))
    for tracker in ("gnn", "pmb", "oracle", "naive"):
        metrics = traffic_result[tracker].metrics
        squares = sum((metrics[f"gospa_{part}"].value or 0.0) ** 2 for part in ("missed", "false"))
        events = [event for event in events_of(traffic_result, tracker) if event.kind != "switched"]
        assert sum(event.cost_m2 for event in events) == pytest.approx(3 * steps * squares)


def test_the_strips_say_how_long_each_object_was_tracked(traffic_result: Result) -> None:
    recorded = traffic_result.to_pandas("objects")
    due = traffic_result.to_pandas("due")
    for tracker in ("gnn", "naive"):
        own = recorded[recorded["tracker"] == tracker]
        for name in ("slow", "fast", "leaving"):
            strip = own[own["object"] == name]
            np.testing.assert_allclose(strip["time_s"].iloc[1:], strip["until_s"].iloc[:-1])
            there = strip[strip["state"] != "not due"]
            instants = (due["object"] == name) & (due["status"] == 2)
            assert (there["until_s"] - there["time_s"]).sum() == pytest.approx(0.1 * instants.sum())


def test_associations_are_of_detections_that_are_there(traffic_result: Result) -> None:
    taken, measurements = traffic_result.to_pandas("taken"), traffic_result.to_pandas("measurements")
    oracle = taken[taken["tracker"] == "oracle"].merge(measurements, on=["scan", "detection"])
    assert len(oracle) == (taken["tracker"] == "oracle").sum() > 50
    assert "false alarm" not in set(oracle["object"])


def test_the_events_that_are_kept_are_the_dearest(
    traffic_text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, traffic_result: Result
) -> None:
    monkeypatch.setattr(timeline, "MOST_EVENTS", 2)
    (tmp_path / "three_cars.yaml").write_text(traffic_text, encoding="utf-8")
    result = tb.run(tmp_path / "three_cars.yaml")
    for tracker in ("gnn", "naive"):
        assert events_of(result, tracker, 0) == events_of(traffic_result, tracker, 0)
        others = [event.cost_m2 for event in events_of(result, tracker) if event.run > 0]
        every = [event.cost_m2 for event in events_of(traffic_result, tracker) if event.run > 0]
        assert others == every[:2]


def test_the_edge_is_where_the_distance_is_the_threshold() -> None:
    noise, turn = np.diag([0.04, 0.09]), 0.3
    pose = np.array([1.0, 2.0, turn])
    scan = Scan(0.0, "lidar", "lidar", np.zeros((2, 0)), np.zeros(0, bool), noise, pose, np.zeros(2), 0.0)
    mean = np.array([[10.0, -4.0], [5.0, 8.0], [1.0, 0.0], [0.0, 2.0]])
    covariance = np.stack([np.diag([1.0, 2.0, 1.0, 1.0]), np.diag([3.0, 0.5, 1.0, 1.0])], axis=2)
    x, y = gate_outlines(scan, mean, covariance, 9.0)
    assert x.shape == y.shape == (2, CORNERS)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for track in range(2):
        spread = covariance[:2, :2, track] + rotation @ noise @ rotation.T
        away = np.stack([x[track], y[track]]) - mean[:2, track, None]
        np.testing.assert_allclose(np.einsum("ic,ij,jc->c", away, np.linalg.inv(spread), away), 9.0)

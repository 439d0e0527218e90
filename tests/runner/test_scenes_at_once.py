"""Runs of several scenes that a built-in tracker takes at once: each as it is by itself, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import truth

from trackbench.base.types import Observer, Truth
from trackbench.metrics.registry import metrics_for
from trackbench.metrics.traffic import TRACKS, TrafficScoreOptions
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.models.sensors import Lidar, Radar
from trackbench.models.sensors.detection import Clutter
from trackbench.results import Failure
from trackbench.runner.loop import run_blocks
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import BlockRuns, Scene, Work
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.multi import MultiObjectTracker, association

EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2.0}
SENSORS = {
    "radar": Radar(
        rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1, fov_deg=120, max_range_m=150,
        detection_probability=0.9, clutter=Clutter(per_scan=4),
    ),
    "lidar": Lidar(rate_hz=5, position_sigma_m=0.15, max_range_m=80, clutter=Clutter(per_scan=3)),
}  # fmt: skip
TRACKERS: dict[str, dict[str, Any]] = {
    "gnn": {**EKF, "associate": {"method": "gnn"}},
    "jpda": {**EKF, "associate": {"method": "jpda"}},
    "jipda": {**EKF, "associate": {"method": "jipda"}},
    "pmb": {**EKF, "associate": {"method": "pmb"}},
    "oracle": {**EKF, "associate": {"method": "oracle"}},
    "of_positions": {**EKF, "filter": "kf", "associate": {"method": "naive"}},
    "sigma_points": {**EKF, "filter": "ukf", "associate": {"method": "pmb"}},
    "by_range": {
        **EKF,
        "associate": {"method": "pmb"},
        "assume": {"radar": {"signal_to_noise": {"stated_at_m": 60, "half_range_m": 120}}},
    },
}


def scene(seed: int, objects: int, steps: int = 31) -> Scene:
    """Objects ahead of a car that turns, two of them side by side."""
    random, time = np.random.default_rng(seed), np.arange(steps) / 10
    x, y = random.uniform(15, 60, objects), random.uniform(-15, 15, objects)
    x[1], y[1] = x[0] + 1.0, y[0] + 1.5
    vx = random.uniform(8, 12, objects)
    yaw = 0.05 * seed * time
    zero = np.zeros(len(time))
    observer = Observer(10 * time, seed + zero, yaw, 10 + zero, zero, 0.05 * seed + zero)
    of: Truth = truth(
        time, (x + vx * time[:, None])[..., None], y[:, None] + 0 * time[:, None, None], vx[:, None], 0.0,
        observer=observer,
    )  # fmt: skip
    return Scene(of, ideal_sensors(of, SENSORS))


def work(engine: Any, steps: int = 31) -> Work:
    """Three scenes with different numbers of objects."""
    trackers = {name: FilterConfig.model_validate(keys) for name, keys in TRACKERS.items()}
    scenes = [scene(seed, objects, steps) for seed, objects in ((1, 4), (2, 6), (3, 3))]
    return Work(
        "test", 5, 3, scenes, trackers, None, 0.0, 1e9, 5.0, 1, 2,
        metrics=metrics_for({"tracks", "truth"}), track_score=TrafficScoreOptions(), engine=engine,
    )  # fmt: skip


def assert_same(outcome: object, alone: object) -> None:
    assert isinstance(outcome, Outcome)
    assert isinstance(alone, Outcome)
    np.testing.assert_array_equal(outcome.sums[TRACKS.name], alone.sums[TRACKS.name])
    np.testing.assert_array_equal(outcome.timeline.gospa, alone.timeline.gospa)
    assert outcome.timeline.events == alone.timeline.events
    own, other = outcome.recorded, alone.recorded
    assert (own is None) == (other is None)
    if own is None or other is None:
        return
    assert isinstance(own, RecordedTracks)
    assert isinstance(other, RecordedTracks)
    for values, others in zip(own.history, other.history, strict=True):
        np.testing.assert_array_equal(values, others)
    np.testing.assert_array_equal(own.taken, other.taken)
    assert own.predicted.keys() == other.predicted.keys()
    for number, tracks in own.predicted.items():
        np.testing.assert_array_equal(tracks.mean, other.predicted[number].mean)


@pytest.mark.parametrize(("engine", "largest_exact"), [("numpy", 6), ("fused", 6), ("fused", 1)])
def test_each_scene_is_as_it_is_by_itself(engine: Any, largest_exact: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(association, "MAX_CLUSTER", largest_exact)
    whole = work(engine, steps=10)
    pieces = whole.pieces()
    assert whole.groups(pieces) == [pieces]
    for block, piece in zip(run_blocks(whole, pieces), pieces, strict=True):
        (alone,) = run_blocks(whole, [piece])
        assert (block.digests, block.detections) == (alone.digests, alone.detections)
        for name in whole.trackers:
            assert_same(block.outcomes[name], alone.outcomes[name])


def test_scenes_that_are_measured_at_other_times_stay_apart() -> None:
    whole = work("numpy")
    scenes = [whole.scenes[0], scene(2, 6, steps=21), whole.scenes[2]]
    pieces = whole.pieces()
    assert replace(whole, scenes=scenes).groups(pieces) == [[pieces[0], pieces[2]], [pieces[1]]]


SHARED = """
import numpy as np
from trackbench.base.types import Tracks

class Shared:
    "Instances count their steps together."
    steps = 0
    def step(self, state, scan):
        Shared.steps += 1
        return state, Tracks(np.array([0]), np.full((4, 1), Shared.steps % 7), np.eye(4)[..., None])
"""


def test_a_plug_in_beside_a_built_in_tracker_is_asked_again(
    tmp_path: Path, write_module: Callable[[Path, str], str]
) -> None:
    whole = work("numpy", steps=16)
    plug_in = PluginConfig.model_validate({"use": f"{write_module(tmp_path, SHARED)}:Shared"})
    trackers = {"gnn": whole.trackers["gnn"], "shared": plug_in}
    whole = replace(whole, trackers=trackers, folder=tmp_path, driven_twice=whole.pieces()[1])
    outcomes = [block.outcomes["shared"] for block in run_blocks(whole, whole.pieces())]
    assert [isinstance(outcome, Failure) for outcome in outcomes] == [False, True, False]
    assert isinstance(outcomes[1], Failure)
    assert "asked again" in outcomes[1].cause


def test_labelled_runs_stay_apart_and_large_groups_are_split() -> None:
    whole = work("numpy")
    pieces = whole.pieces()
    assert replace(whole, track_score=None).groups(pieces) == [[piece] for piece in pieces]
    pieces = replace(whole, runs=100).pieces()
    # 400 and 600 objects and runs, and 300.
    assert whole.groups(pieces) == [pieces[:2], pieces[2:]]


def test_a_tracker_that_fails_says_of_each_scene_where(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = work("numpy")
    whole = replace(whole, trackers={"gnn": whole.trackers["gnn"]})
    step, turning = MultiObjectTracker.step, [float(part.truth.observer.py[0]) for part in whole.scenes]

    def failing(self: Any, state: Any, scan: Any, origins: Any = None) -> Any:
        # In the last scene alone, late.
        if scan.time > 2.0 and np.any(np.atleast_2d(scan.sensor_pose.T)[:, 1] == turning[2]):
            raise ArithmeticError("lost")
        return step(self, state, scan, origins)

    monkeypatch.setattr(MultiObjectTracker, "step", failing)
    blocks = run_blocks(whole, whole.pieces())
    failed = [isinstance(block.outcomes["gnn"], Failure) for block in blocks]
    assert failed == [False, False, True]
    assert BlockRuns(2, range(3)) == blocks[2].piece

"""Scans that are made while an episode goes on are those that the bench makes of the whole motion, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trackbench.base.types import Truth
from trackbench.scenario import Scenario
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import ideal_sensors
from trackbench.sensing.view import sensor_reach
from trackbench.subjects.gym.sensing import EpisodeSensing
from trackbench.subjects.gym.setting import setting_of
from trackbench.truth.driven import LatestTruth

STEPS, EVERY, DT = 60, 7, 0.1
RADAR = {"type": "radar", "rate_hz": 5, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1,
         "fov_deg": 150, "max_range_m": 120, "detection_probability": 0.8, "occlusion": True,
         "clutter": {"per_scan": 3}}  # fmt: skip
LIDAR = {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2, "max_range_m": 90, "clutter": {"per_scan": 1}}
SENSORS = {
    "plain": {"radar": RADAR, "lidar": LIDAR},
    "late": {"radar": {**RADAR, "latency_s": [0.05, 0.4]}, "lidar": {**LIDAR, "rate_hz": 5, "phase_s": 0.1}},
    "resolution": {"radar": {**RADAR, "resolution": {"range_m": 4, "azimuth_deg": 6}}},
    "effects with a memory": {
        "radar": {
            **RADAR,
            "effects": [
                {"type": "reflection", "along_m": 0.4},
                {"type": "bias", "sigmas": {"azimuth_deg": 0.5}},
                {"type": "signal_to_noise", "half_range_m": 60, "stated_at_m": 30},
                {"type": "correlated_errors", "share": 0.8, "time_s": 1},
            ],
        },
    },
}


def setting(sensors: dict[str, Any]) -> Scenario:
    config = {"simulation_frequency": 10, "policy_frequency": 1}
    return setting_of("highway-v0", config, None, sensors, "gnn")


def traffic() -> Truth:
    """Three cars, one of which comes after a while, around an observer that turns."""
    random = np.random.default_rng(4)
    time = DT * np.arange(STEPS)
    shape = (STEPS, 3, 1)
    start, speed = np.array([10.0, 25.0, 60.0]), np.array([20.0, 22.0, 18.0])
    px = (start + speed * time[:, None])[..., None] - 12.0 * time[:, None, None]
    zero = np.zeros(shape)
    alive = np.ones((STEPS, 3), dtype=bool)
    alive[:20, 2] = False
    from trackbench.base.types import Observer

    observer = Observer(*(12.0 * time if i == 3 else 0.05 * time if i == 2 else np.zeros(STEPS) for i in range(6)))
    return Truth(
        time, ("a", "b", "c"), px, zero + np.array([0.0, 3.0, -4.0])[:, None], zero, zero,
        np.broadcast_to((speed - 12.0)[:, None], shape).copy(), zero, 0.01 * random.standard_normal(shape),
        alive, np.full(3, 5.0), np.full(3, 2.0), observer,
    )  # fmt: skip


def pieces(truth: Truth) -> list[LatestTruth]:
    """The truth piece by piece, as it becomes known."""
    result, first = [], 0
    for last in [0, *range(EVERY, STEPS, EVERY), STEPS - 1]:
        part = slice(first, last + 1)
        names = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate", "alive", "time")
        observer = replace(
            truth.observer,
            **{name: getattr(truth.observer, name)[part] for name in ("px", "py", "yaw", "vx", "vy", "yaw_rate")},
        )
        piece = replace(truth, observer=observer, **{name: getattr(truth, name)[part] for name in names})
        result.append(LatestTruth(piece, first, 0 if last == 0 else first + 1))
        first = last
    return result


@pytest.mark.parametrize("name", SENSORS)
def test_piece_by_piece_is_as_all_at_once(name: str) -> None:
    sensors = setting(SENSORS[name]).config.sensors
    truth = traffic()
    assert sensor_reach(sensors.values()) > 0
    whole = sense_hidden(ideal_sensors(truth, sensors), 11, "episodes", range(2, 3))
    episode = EpisodeSensing(sensors, truth.time, 11, "episodes", 2)
    arrived = []
    for latest in pieces(truth):
        now = latest.truth.time[-1]
        for item in episode.arrived(latest):
            assert item.scan.time <= item.scan.arrival_time <= now + 1e-6
            arrived.append(item)
    wanted = [i for i, scan in enumerate(whole.scans) if scan.arrival_time <= truth.time[-1] + 1e-6]
    assert len(arrived) == len(wanted) > 25
    by_name = {(item.scan.sensor, item.scan.time): item for item in arrived}
    for i in wanted:
        scan, item = whole.scans[i], by_name[whole.scans[i].sensor, whole.scans[i].time]
        assert np.array_equal(item.scan.measurement, scan.measurement, equal_nan=True)
        assert np.array_equal(item.origins, np.stack([whole.origins[i], whole.merged[i]]))
        for mine, theirs in zip(item.scan, scan, strict=True):
            assert np.array_equal(mine, theirs, equal_nan=True) if isinstance(mine, np.ndarray) else mine == theirs
    assert any((whole.origins[i] >= 0).any() for i in wanted)


def test_each_episode_and_seed_has_its_own_noise() -> None:
    sensors, truth = setting(SENSORS["plain"]).config.sensors, traffic()
    drawn = set()
    for seed, run in ((1, 0), (1, 1), (2, 0)):
        (first, *_) = EpisodeSensing(sensors, truth.time, seed, "episodes", run).arrived(pieces(truth)[0])
        drawn.add(first.scan.measurement.tobytes())
    assert len(drawn) == 3

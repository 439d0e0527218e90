"""Scans that are made while an episode goes on are those that the bench makes of the whole motion, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.types import KINEMATICS, Observer, Scan, Truth, scan_of_run
from trackbench.models.sensors import Sensor
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.episodes import EpisodeSensing
from trackbench.sensing.scans import ideal_sensors, sense_known

STEPS, DT = 60, 0.1
KNOWN = {"type": "radar", "rate_hz": 5, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1,
         "fov_deg": 150, "max_range_m": 120, "detection_probability": 0.8, "occlusion": True}  # fmt: skip
RADAR = {**KNOWN, "clutter": {"per_scan": 3}}
LIDAR = {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2, "max_range_m": 90}
CLUTTERED = {**LIDAR, "clutter": {"per_scan": 1}}
EFFECTS = [
    {"type": "reflection", "along_m": 0.4},
    {"type": "bias", "sigmas": {"azimuth_deg": 0.5}},
    {"type": "signal_to_noise", "half_range_m": 60, "stated_at_m": 30},
    {"type": "correlated_errors", "share": 0.8, "time_s": 1},
]
SENSORS = {
    "plain": {"radar": RADAR, "lidar": CLUTTERED},
    "late": {"radar": {**RADAR, "latency_s": [0.05, 0.4]}, "lidar": {**CLUTTERED, "rate_hz": 5, "phase_s": 0.1}},
    "resolution": {"radar": {**RADAR, "resolution": {"range_m": 4, "azimuth_deg": 6}}},
    "effects with a memory": {"radar": {**RADAR, "effects": EFFECTS}},
    "known": {"radar": {**KNOWN, "latency_s": 0.2}, "lidar": LIDAR},
    "known, effects with a memory": {"radar": {**KNOWN, "effects": EFFECTS}},
}


def sensors_of(name: str) -> Mapping[str, Sensor]:
    truth = {"source": "scripted", "duration_s": 6, "rate_hz": 10, "objects": {"a": {"start": {"x": 10}}}}
    filter = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}
    hidden = not name.startswith("known")
    keys: dict[str, Any] = {"truth": truth, "sensing": {"identities": "hidden" if hidden else "known"}}
    trackers = {"ekf": {**filter, **({"associate": {"method": "gnn"}} if hidden else {})}}
    return tb.load({"name": "episodes", **keys, "sensors": SENSORS[name], "trackers": trackers}).config.sensors


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
    observer = Observer(*(12.0 * time if i == 3 else 0.05 * time if i == 2 else np.zeros(STEPS) for i in range(6)))
    return Truth(
        time, ("a", "b", "c"), px, zero + np.array([0.0, 3.0, -4.0])[:, None], zero, zero,
        np.broadcast_to((speed - 12.0)[:, None], shape).copy(), zero, 0.01 * random.standard_normal(shape),
        alive, np.full(3, 5.0), np.full(3, 2.0), observer,
    )  # fmt: skip


def until(truth: Truth, steps: int) -> Truth:
    """The first steps of the truth."""
    motion = ("px", "py", "yaw", "vx", "vy", "yaw_rate")
    observer = replace(truth.observer, **{name: getattr(truth.observer, name)[:steps] for name in motion})
    arrays = {name: getattr(truth, name)[:steps] for name in (*KINEMATICS, "alive", "time")}
    return replace(truth, observer=observer, **arrays)


def sensed(sensing: EpisodeSensing, truth: Truth, every: int) -> Iterator[Scan]:
    """The scans of an episode whose motion becomes known some steps at a time."""
    for steps in [1, *range(1 + every, STEPS, every), STEPS]:
        now = truth.time[steps - 1]
        for scan in sensing.arrived(until(truth, steps)):
            assert scan.time <= scan.arrival_time <= now + 1e-6
            yield scan


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("every", [1, 7])
def test_piece_by_piece_is_as_all_at_once(name: str, every: int) -> None:
    sensors, truth, hidden = sensors_of(name), traffic(), not name.startswith("known")
    ideal = ideal_sensors(truth, sensors)
    if hidden:
        whole = [scan_of_run(scan, 0) for scan in sense_hidden(ideal, 11, "episodes", range(1)).scans]
    else:
        whole = sense_known(ideal, 11, "episodes", range(1)).scans
    wanted = [scan for scan in whole if scan.arrival_time <= truth.time[-1] + 1e-6]
    arrived = list(sensed(EpisodeSensing(sensors, truth.time, 11, "episodes", hidden), truth, every))
    assert len(arrived) == len(wanted) > 25
    assert sum(scan.valid.sum() for scan in arrived) > 25
    by_name = {(scan.sensor, scan.time): scan for scan in arrived}
    for scan in wanted:
        for mine, theirs in zip(by_name[scan.sensor, scan.time], scan, strict=True):
            assert np.array_equal(mine, theirs, equal_nan=True) if isinstance(mine, np.ndarray) else mine == theirs


def test_scans_come_in_the_order_of_their_arrival() -> None:
    sensing, truth = EpisodeSensing(sensors_of("late"), traffic().time, 11, "episodes", hidden=True), traffic()
    scans = list(sensed(sensing, truth, 7))
    assert [scan.arrival_time for scan in scans] == sorted(scan.arrival_time for scan in scans)
    assert [scan.time for scan in scans] != sorted(scan.time for scan in scans)


def test_each_seed_has_its_own_noise() -> None:
    sensors, truth = sensors_of("plain"), traffic()
    first = [EpisodeSensing(sensors, truth.time, seed, "episodes", True).arrived(until(truth, 1)) for seed in (1, 2)]
    assert len({scans[0].measurement.tobytes() for scans in first}) == 2

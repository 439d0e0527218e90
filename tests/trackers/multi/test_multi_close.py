"""Detections side by side, and the pairs of tracks and detections that are close, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.base.types import Array, Scan
from trackbench.base.units import difference
from trackbench.engine.equations import by_numpy
from trackbench.filters import Measured, PredictedMeasurement
from trackbench.trackers.multi.gate import RunDetections, close_pairs, gated, run_detections


def scan_of(random: np.random.Generator, runs: int, most: int, decimals: int | None = None) -> Scan:
    """Of up to ``most`` detections a run; rounded, so that some are alike."""
    counts = random.integers(0, most + 1, runs)
    counts[random.integers(runs)] = most
    valid = np.arange(most)[:, None] < counts
    values = random.uniform(-50.0, 50.0, (2, most, runs))
    values = np.where(valid, values if decimals is None else values.round(decimals), np.nan)
    return Scan(0.0, "a", "lidar", values, valid, np.eye(2), np.zeros(3), np.zeros(2), 0.0)


@pytest.mark.parametrize("decimals", [None, -1])
@pytest.mark.parametrize("runs", [1, 7])
def test_detections_stand_by_run_and_value(runs: int, decimals: int | None) -> None:
    scan = scan_of(np.random.default_rng(runs), runs, 12, decimals)
    found = run_detections(scan, as_listed=False)
    at = 0
    for run in range(runs):
        count = int(scan.valid[:, run].sum())
        own = slice(at, at + count)
        assert found.first[run] == at
        assert np.all(found.run[own] == run)
        expected = sorted(map(tuple, scan.measurement[:, :count, run].T))
        assert [tuple(each) for each in found.scan.measurement[:, own].T] == expected
        np.testing.assert_array_equal(scan.measurement[:, found.column[own], run], found.scan.measurement[:, own])
        at += count
    assert at == found.first[-1] == len(found.run) == found.scan.measurement.shape[1]
    assert found.scan.valid.all()


def test_detections_stand_as_listed_where_that_is_asked() -> None:
    scan = scan_of(np.random.default_rng(5), 6, 9)
    found = run_detections(scan, as_listed=True)
    expected = [scan.measurement[:, column, run] for run in range(6) for column in np.flatnonzero(scan.valid[:, run])]
    np.testing.assert_array_equal(found.scan.measurement.T, expected)


def one_by_one(mean: Array, reach: Array, run: Array, value: Array, detections: RunDetections) -> list[tuple[int, int]]:
    return [
        (track, detection)
        for track in range(len(mean))
        for detection in range(len(value))
        if run[track] == detections.run[detection] and abs(value[detection] - mean[track]) <= reach[track]
    ]


@pytest.mark.parametrize("seed", range(6))
def test_close_pairs_are_those_of_each_pair(seed: int) -> None:
    random = np.random.default_rng(seed)
    runs = int(random.integers(1, 6))
    detections = run_detections(scan_of(random, runs, 20, decimals=1), as_listed=bool(seed % 2))
    value = detections.scan.measurement[0]
    run = np.sort(random.integers(0, runs, 40))
    # Reaches that end at a detection, that hold all of them, and such as a track that is lost has.
    mean = random.uniform(-60.0, 60.0, 40).round(1)
    reach = random.choice([0.0, 0.1, 2.0, 30.0, 1e9, np.inf], 40)
    mean[::9], reach[::13] = np.nan, np.nan
    track, detection = close_pairs(mean, reach, run, value, detections, angular=False)
    assert list(zip(track, detection, strict=True)) == one_by_one(mean, reach, run, value, detections)


@pytest.mark.parametrize("noise_of_each", [False, True])
@pytest.mark.parametrize("angular", [(), (1,), (0, 1)])
def test_no_pair_in_a_gate_is_left_out(angular: tuple[int, ...], noise_of_each: bool) -> None:
    random = np.random.default_rng(len(angular))
    counts, tracks, threshold = np.array([12, 0, 70]), 40, 4.0
    value, mean = random.uniform(-3.1, 3.1, (2, counts.sum())), random.uniform(-3.1, 3.1, (2, tracks))
    noise = 0.1 * np.eye(2)
    if noise_of_each:
        noise = noise[..., None] * random.uniform(0.1, 2.0, counts.sum())
    root = random.normal(0.0, 0.5, (2, 2, tracks))
    predicted = PredictedMeasurement(mean, np.einsum("ik...,jk...->ij...", root, root), np.zeros((2, 4, tracks)))
    scan = Scan(0.0, "a", "lidar", value, np.ones(len(value[0]), bool), np.eye(2), np.zeros(3), np.zeros(2), 0.0)
    run, group = np.repeat(np.arange(3), counts), np.sort(random.integers(0, 3, tracks))
    detections = RunDetections(scan, run, run, np.concatenate([[0], counts.cumsum()]))
    pairs = gated(predicted, Measured(value, noise, angular), detections, group, threshold, by_numpy)
    expected = []
    for i, j in zip(*np.nonzero(group[:, None] == run), strict=True):
        apart = difference(value[:, j], mean[:, i], angular)
        spread = predicted.covariance[..., i] + (noise[..., j] if noise_of_each else noise)
        if apart @ np.linalg.solve(spread, apart) <= threshold:
            expected.append((i, j))
    assert len(expected) > 20
    assert list(zip(pairs.track, pairs.detection, strict=True)) == expected

"""Pairs found by machine code, against those found one by one."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from tests.engine.test_vector_code import PROCESSORS, of_processor

from trackbench.base.types import Array, Indices, Scan
from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import Kernels
from trackbench.engine.pairs import PairSearch
from trackbench.filters import Measured, PredictedMeasurement
from trackbench.trackers.multi.fused_tracks import close_in_all
from trackbench.trackers.multi.gate import RunDetections, close_in_one, gated

SHAPES: dict[str, tuple[int, ...]] = {"mean": (2,), "value": (2,), "reach": (2,)}


def _near(values: Values) -> Values:
    apart = [values["value"][i] - values["mean"][i] for i in range(2)]
    return {"near": (abs(apart[0]) <= values["reach"][0]) & (abs(apart[1]) <= values["reach"][1])}


NEAR = Equations("near", _near, {"mean": 1, "value": 1, "reach": 1})


@pytest.mark.parametrize("processor", [None, *PROCESSORS])
@pytest.mark.parametrize("most", [0, 1, 5, 17, 200])
def test_pairs_are_those_found_one_by_one(kernels: Kernels, processor: str | None, most: int, tmp_path: Path) -> None:
    kernels = kernels if processor is None else of_processor(processor, tmp_path, kernels)
    search = PairSearch(kernels, NEAR, SHAPES, {"mean"}, {"value"})
    random = np.random.default_rng(most)
    for groups in (1, 4):
        bounds = np.concatenate([[0], random.integers(0, most + 1, groups).cumsum()])
        group = random.integers(0, groups, 30)
        mean, value = random.uniform(-9.0, 9.0, (2, 30)), random.uniform(-9.0, 9.0, (2, bounds[-1]))
        # Edges, and what is no number.
        mean[0, ::7], value[1, ::5], reach = np.nan, np.nan, np.array([3.0, np.inf])
        mean[0, 1:3], value[0, 1::4] = 1.0, 4.0
        found = search({"mean": mean, "value": value, "reach": reach}, group, bounds)
        expected = [
            (i, j)
            for i in range(30)
            for j in range(bounds[group[i]], bounds[group[i] + 1])
            if abs(value[0, j] - mean[0, i]) <= 3.0 and abs(value[1, j] - mean[1, i]) <= np.inf
        ]
        assert list(zip(*found, strict=True)) == expected


@pytest.mark.parametrize("noise_of_each", [False, True])
@pytest.mark.parametrize("angular", [(), (1,), (0, 1)])
def test_no_pair_in_a_gate_is_left_out(kernels: Kernels, angular: tuple[int, ...], noise_of_each: bool) -> None:
    random = np.random.default_rng(len(angular))
    counts, tracks = np.array([12, 0, 70]), 40
    value, mean = random.uniform(-3.1, 3.1, (2, counts.sum())), random.uniform(-3.1, 3.1, (2, tracks))
    noise = 0.1 * np.eye(2)
    if noise_of_each:
        noise = noise[..., None] * random.uniform(0.1, 2.0, counts.sum())
    root = random.normal(0.0, 0.5, (2, 2, tracks))
    predicted = PredictedMeasurement(mean, np.einsum("ik...,jk...->ij...", root, root), np.zeros((2, 4, tracks)))
    scan = Scan(0.0, "a", "lidar", value, np.ones(len(value[0]), bool), np.eye(2), np.zeros(3), np.zeros(2), 0.0)
    run = np.repeat(np.arange(3), counts)
    detections = RunDetections(scan, run, run, np.concatenate([[0], counts.cumsum()]))
    group = np.sort(random.integers(0, 3, tracks))
    asked = predicted, Measured(value, noise, angular), detections, group, 4.0, kernels
    found, expected = gated(*asked, close_in_all), gated(*asked, close_in_one)
    assert len(expected.track) > 20
    for part, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(part, wanted)


def test_threads_search_at_once(kernels: Kernels) -> None:
    search = PairSearch(kernels, NEAR, SHAPES, {"mean"}, {"value"})
    random, bounds, reach = np.random.default_rng(1), np.array([0, 900]), np.array([3.0, 3.0])
    cases = [(random.uniform(-9.0, 9.0, (2, 900)), random.uniform(-9.0, 9.0, (2, 900))) for _ in range(8)]

    def pairs(case: tuple[Array, Array]) -> tuple[Indices, Indices]:
        mean, value = case
        return search({"mean": mean, "value": value, "reach": reach}, np.zeros(900, dtype=np.int64), bounds)

    expected = [pairs(case) for case in cases]
    with ThreadPoolExecutor(4) as threads:
        for _ in range(20):
            for found, wanted in zip(threads.map(pairs, cases), expected, strict=True):
                for part, same in zip(found, wanted, strict=True):
                    np.testing.assert_array_equal(part, same)

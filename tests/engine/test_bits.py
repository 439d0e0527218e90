"""The same bits however a batch is split, and by however many workers."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from tests.base.execution.results import without_times
from tests.engine.agreement import Drive, drive

from trackbench.base.execution import executor
from trackbench.base.types import Array
from trackbench.engine.beliefs import REUSED, belief_values
from trackbench.engine.filters import FusedFilter
from trackbench.engine.kernels import Kernels
from trackbench.runner import work
from trackbench.runner.run import run_scenario
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.truth import truths_of

BATCH = 1000
#: A filter of several models gives other digits where a batch has no measurement at all, so that none is of one alone.
SPLITS = [[125] * 8, [3, 5, 8, 9, 475, 500], [997, 3]]
#: Tracks that start with an unknown course lead many members into the branches that NumPy computes.
STARTS = {"near the truth": None, "unknown": {"from": "first_measurement", "velocity_sigma_mps": 10}}


def said(given: Drive, name: str, start: str, kernels: Kernels) -> list[Array]:
    """What a tracker believes and says of the objects after each scan."""
    of, state = given.tracker(name, "fused", STARTS[start]), None
    of.__dict__["computed_filter"] = FusedFilter(of.filter, kernels)
    found: list[Array] = []
    for scan in given.scans:
        state, estimate = of.step(state, scan)
        marks = np.zeros(scan.valid.shape, dtype=bool) if estimate.repaired is None else estimate.repaired
        believed = belief_values(state.belief, without=REUSED)
        found += [estimate.mean, estimate.covariance, marks, *believed.values()]
    return found


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("name", ["kf-ca", "ekf-cv", "ukf-ctrv", "ekf-imm"])
def test_however_a_batch_is_split(name: str, start: str, kernels: Kernels) -> None:
    given = drive(12, BATCH)
    whole = said(given, name, start, kernels)
    for sizes in SPLITS:
        ends = itertools.accumulate(sizes, initial=0)
        parts = [said(given.part(slice(*each)), name, start, kernels) for each in itertools.pairwise(ends)]
        for expected, *found in zip(whole, *parts, strict=True):
            assert np.concatenate(found, axis=-1).tobytes() == expected.tobytes(), sizes


SCENARIO = """\
name: bits
description: Two cars that drive past a radar and a lidar
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  objects:
    a: {start: {x: 30, speed_mps: 10}, pieces: [{for_s: 2}]}
    b: {start: {x: 60, speed_mps: 5}, pieces: [{for_s: 2}]}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
  lidar: {type: lidar, rate_hz: 5, position_sigma_m: 0.2, detection_probability: 0.8}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}
  kf: {filter: kf, motion: cv, acceleration_sigma_mps2: 3, initial: {from: two_measurements}}
monte_carlo: {runs: 24, seed: 7}
"""


@pytest.mark.usefixtures("kernels")
def test_by_however_many_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "BATCH_SIZE", 4)
    monkeypatch.setattr(work, "LARGEST_BATCH", 4)
    file = tmp_path / "bits.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    assert_same_with_two_workers(load_scenario(file))


def assert_same_with_two_workers(loaded: Scenario) -> None:
    truths = truths_of(loaded)
    alone = run_scenario(loaded, truths, engine="fused")
    assert alone.summary.engine != "numpy"
    with executor(2) as two:
        assert without_times(run_scenario(loaded, truths, executor=two, engine="fused")) == without_times(alone)

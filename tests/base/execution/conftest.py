"""A scenario of several blocks, with a metric of its own beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from trackbench.runner import work
from trackbench.scenario import Scenario, load_scenario

SCENARIO = """\
name: NAME
description: Two cars that drive past a radar
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  objects:
    a: {start: {x: 30, speed_mps: 10}, pieces: [{for_s: 2}]}
    b: {start: {x: 60, speed_mps: 5}, pieces: [{for_s: 2}]}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
trackers:
  raw: {use: raw}
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}
score:
  metrics: ["MODULE:Within"]
monte_carlo: {runs: 24, seed: 7}
"""

#: It takes its time, so that a worker can be killed within a block.
METRIC = """\
import time
import numpy as np
from trackbench.metrics import Metric, ratio


class Within(Metric):
    '''Share of the estimates that are near the truth.'''
    name, unit, meaning, better = "within", "1", "share of the estimates that are near the truth", "larger"

    def init(self, scope):
        print("a metric speaks")
        time.sleep(0.1)
        return np.zeros((2, scope.runs))

    def update(self, sums, chunk):
        near = np.hypot(chunk.error[0], chunk.error[1]) < 0.5
        return sums + [chunk.by_run(1.0), chunk.by_run(near)]

    def merge(self, blocks):
        return np.concatenate(blocks, axis=1)

    def finish(self, sums):
        return ratio(sums[1], sums[0], at_least=0.0)
"""

Write = Callable[..., Scenario]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write_module: Callable[[Path, str], str]) -> Write:
    """Writes a scenario of twelve blocks under a name."""
    monkeypatch.setattr(work, "BATCH_SIZE", 4)
    monkeypatch.setattr(work, "LARGEST_BATCH", 4)
    module = write_module(tmp_path, METRIC)

    def call(name: str = "line", *settings: str) -> Scenario:
        file = tmp_path / f"{name}.yaml"
        file.write_text(SCENARIO.replace("NAME", name).replace("MODULE", module), encoding="utf-8")
        return load_scenario(file, settings)

    return call


@pytest.fixture
def line(write: Write) -> Scenario:
    """One of them."""
    return write()

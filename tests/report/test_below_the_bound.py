"""A contender with smaller errors than the Cramér-Rao bound is named: it knows more than its measurements."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import trackbench as tb
from trackbench.report.sentences import below_the_bound

PEEKS = """
import numpy as np


class Peeks:
    batched = True
    random = True

    def step(self, state, scan):
        # Of one object: all members share its truth.
        position = 0.9 * np.mean(scan.measurement, axis=1, keepdims=True) + 0.1 * scan.measurement
        zero = np.zeros_like(position)
        return None, (np.concatenate([position, zero + [[5.0], [0.0]]]), np.eye(4)[:, :, None] + zero[:1, None])
"""

SCENARIO = {
    "name": "bound",
    "truth": {
        "source": "scripted", "duration_s": 4, "rate_hz": 10,
        "objects": {"ahead": {"start": {"x": 20, "speed_mps": 5}}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3}},
    "monte_carlo": {"runs": 40, "seed": 1},
}  # fmt: skip


def test_a_tracker_that_averages_over_runs_is_named_and_an_honest_one_is_not(
    tmp_path: Path, write_module: Callable[[Path, str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    trackers = {
        "ekf": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 0.1},
        "peeks": {"use": f"{write_module(tmp_path, PEEKS)}:Peeks"},
    }
    result = tb.run(tb.load({**SCENARIO, "trackers": trackers}))
    assert result.summary.held_against.kind == "bound"
    assert below_the_bound(result) == ["peeks is below the Cramér-Rao bound: it knows more than its measurements say"]

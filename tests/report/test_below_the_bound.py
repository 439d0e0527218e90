"""A tracker with smaller errors than the Cramér-Rao bound is not ranked: it knows more than its measurements."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

import trackbench as tb
from trackbench.report.console import print_summary
from trackbench.report.sentences import below_the_bound
from trackbench.report.tables import unranked_table
from trackbench.results import MetricValue, Result

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


def test_a_tracker_that_averages_over_runs_is_not_ranked_and_an_honest_one_is(
    tmp_path: Path, write_module: Callable[[Path, str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    trackers = {
        "ekf": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 0.1},
        "peeks": {"use": f"{write_module(tmp_path, PEEKS)}:Peeks"},
    }
    result = tb.run(tb.load({**SCENARIO, "trackers": trackers}))
    assert result.summary.held_against.kind == "bound"
    assert result.summary.ranking == ["ekf", "peeks"]
    assert [tracker.name for tracker in result.scored] == ["ekf"]
    reason = "it is below the Cramér-Rao bound: it knows more than its measurements say (random = True)"
    assert result.why_unscored(result["peeks"]) == reason
    assert not result.differences
    numbers = unranked_table(result)
    assert numbers is not None
    assert [row[0].tracker for row in numbers.rows] == ["peeks"]
    error = result["peeks"].position_rmse.value
    assert error is not None
    assert numbers.rows[0][1].text == f"{error:.4f}"
    assert f"{reason}; position RMSE {error:.4f} m" in " ".join(printed(result).split())


def test_one_that_is_driven_a_second_time_is_named(tiny_result: Result) -> None:
    ratio = MetricValue(value=0.8, ci95=(0.7, 0.9), unit="1")
    ekf = tiny_result["ekf"]
    ekf = ekf.model_copy(update={"metrics": {**ekf.metrics, "position_over_reference": ratio}})
    reference = tiny_result.summary.held_against.model_copy(update={"kind": "bound"})
    result = tiny_result.updated(trackers=[ekf, tiny_result["raw"]], reference=reference)
    assert below_the_bound(result) == ["ekf is below the Cramér-Rao bound: it knows more than its measurements say"]
    assert not result.why_unscored(ekf)


def printed(result: Result) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    print_summary(result, console)
    return console.export_text()

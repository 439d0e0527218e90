"""What metrics need of a scenario, and which of them it has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.metrics import BUILT_IN
from trackbench.metrics.registry import by_path, metrics_for
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS

Write = Callable[[Path, str], str]

BOTH = """
import numpy as np
from trackbench.metrics import Metric

class Steps(Metric):
    name, unit, meaning, better = "steps", "1", "number of steps", None
    needs = {needs}
    def init(self, scope):
        return 0.0
    def update(self, sums, part):
        return sums + part.steps
    def merge(self, blocks):
        return sum(blocks)
    def finish(self, sums):
        return sums
"""
TRAFFIC = """
name: both
truth: {{source: scripted, duration_s: 2, rate_hz: 10, objects: {{a: {{start: {{x: 10, y: 20, speed_mps: 8}}}}}}}}
sensing: {{identities: {identities}}}
sensors: {{lidar: {{type: lidar, rate_hz: 10, position_sigma_m: 0.15, max_range_m: 60}}}}
trackers: {{kf: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1{associate}}}}}
monte_carlo: {{runs: 3, seed: 3}}
score: {{metrics: ["{module}:Steps"]}}
expect: [{{tracker: kf, metric: position_rmse, below: 9}}, {{tracker: kf, metric: step_time, above: 0}}]
"""


def test_a_scenario_has_what_its_properties_allow() -> None:
    assert metrics_for({"labels", "truth"}) == BUILT_IN
    names = [metric.name for metric in metrics_for({"tracks", "truth"})]
    assert names == ["step_time", *TRACK_METRICS]
    assert [metric.name for metric in metrics_for({"tracks", "no truth"})] == ["step_time", *DETECTION_METRICS]
    assert "health.reused_ids" not in by_path(["lidar"], (), {"labels", "truth"})
    assert "nis.lidar.mean" not in by_path(["lidar"], (), {"tracks", "truth"})


@pytest.mark.parametrize(
    ("identities", "associate", "steps"), [("known", "", 63), ("hidden", ", associate: {method: gnn}", 57)]
)
def test_one_that_needs_a_truth_alone_is_of_estimates_and_of_tracks(
    tmp_path: Path, write_module: Write, identities: str, associate: str, steps: int
) -> None:
    module = write_module(tmp_path, BOTH.replace("{needs}", '{"truth"}'))
    file = tmp_path / "both.yaml"
    file.write_text(TRAFFIC.format(module=module, identities=identities, associate=associate), encoding="utf-8")
    result = tb.run(tb.load(file), workers=1)
    # Of tracks the first tenth of the scans is not timed.
    assert result["kf"].metrics["steps"].value == steps
    assert result.summary.passed


def test_needs_that_there_are_not_are_one_message(tmp_path: Path, write_module: Write) -> None:
    module = write_module(tmp_path, BOTH.replace("{needs}", '{"estimates"}'))
    file = tmp_path / "both.yaml"
    file.write_text(TRAFFIC.format(module=module, identities="known", associate=""), encoding="utf-8")
    with pytest.raises(InputError, match="its needs must be a set of labels, no truth, tracks, truth"):
        tb.load(file)

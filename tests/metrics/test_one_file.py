"""One class in one file makes a metric: every command knows it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trackbench.compare import compare_results, find_results
from trackbench.results import Result

TRACKS = """
import numpy as np
from trackbench.metrics import Metric, ratio

class Tracks(Metric):
    needs = {"tracks", "truth"}
    name, unit, meaning, better = "tracks", "1", "mean number of tracks", "smaller"
    def init(self, scope):
        return []
    def update(self, sums, run):
        return [*sums, np.isfinite(run.tracks.mean[0]).sum() / len(run.truth.time)]
    def merge(self, blocks):
        return [number for block in blocks for number in block]
    def finish(self, sums):
        return ratio(np.array(sums), np.ones(len(sums)), at_least=0.0)
"""
TRAFFIC = """
name: own_of_tracks
truth: {{source: scripted, duration_s: 4, rate_hz: 10, objects: {{a: {{start: {{x: 10, y: 20, speed_mps: 8}}}}}}}}
sensing: {{identities: hidden}}
sensors: {{lidar: {{type: lidar, rate_hz: 10, position_sigma_m: 0.15, max_range_m: 60, clutter: {{per_scan: 3}}}}}}
trackers:
  gnn: {{filter: kf, motion: cv, acceleration_sigma_mps2: 1, associate: {{method: gnn}}}}
  many: {{filter: kf, motion: cv, acceleration_sigma_mps2: 20, associate: {{method: gnn, confirm: [1, 2]}}}}
monte_carlo: {{runs: 6, seed: 3}}
score: {{metrics: ["{module}:Tracks"]}}
expect: [{{tracker: gnn, metric: tracks, below: 9}}, {{tracker: gnn, metric: tracks, better_than: many}}]
"""


def test_one_of_tracks_goes_the_same_way(
    tmp_path: Path, write_module: Callable[[Path, str], str], cli: Callable[..., Any]
) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(TRAFFIC.format(module=write_module(tmp_path, TRACKS)), encoding="utf-8")
    assert cli("run", file, "--no-recording", "--out", "run", "--in-process").status in (0, 1)
    result = Result.load(tmp_path / "run" / "own_of_tracks")
    gnn, many = (result[name].metrics["tracks"] for name in ("gnn", "many"))
    assert 0 < gnn.value < many.value
    assert gnn.ci95 is not None
    assert [item.passed for item in result.summary.expectations] == [True, True]
    (item,) = compare_results([find_results(tmp_path / "run" / "own_of_tracks")], metrics=["tracks"]).differences
    assert item.verdict in ("better", "worse")
    assert "mean number of tracks" in result.summary.score.metrics[-1].meaning
    assert cli("report", "run/own_of_tracks", "--format", "csv", "--out", "csv").status == 0
    (others,) = (tmp_path / "csv").rglob("other-metrics.csv")
    assert others.read_text(encoding="utf-8").startswith("tracker,tracks")
    for objective in ("tracks", "gospa"):
        options = ("--trackers", "gnn", "--objective", objective, "--trials", "2", "--out", "tuned.yaml")
        done = cli("tune", file, *options, "--in-process")
        assert done.status == 0, done.err
        found = json.loads((tmp_path / "tuned.json").read_text(encoding="utf-8"))
        assert objective in {item["metric"] for tracker in found["trackers"] for item in tracker["held_out"]}

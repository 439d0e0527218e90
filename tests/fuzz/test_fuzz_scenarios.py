"""Whatever is in a scenario file, it is checked and run, or refused in one message."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.fuzz.conftest import Tried
from tests.fuzz.mutations import EXTREMES, cases, edited_bytes, edited_text, edited_tree

from trackbench.scenario.docs import EXAMPLES

SCRIPTED = """\
name: scripted
truth:
  source: scripted
  duration_s: 1
  rate_hz: 20
  objects:
    car:
      start: {x: 20, y: 5, speed_mps: 8, course_deg: 30}
      pieces:
        - {for_s: 0.5, turn_rate_degps: 20}
        - {acceleration_mps2: 1}
    bus: {start: {x: 30, vx_mps: -3}, pieces: [{white: {motion: cv, acceleration_sigma_mps2: 2}}]}
    van: {pieces: [{waypoints: [[10, 0], [10, 10]], speed_mps: 9}]}
  observer: {x: 0, y: 0, yaw_deg: 10, vx_mps: 1}
sensors:
  front:
    type: radar
    rate_hz: 10
    mount: {x_m: 3, yaw_deg: 5}
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.1
    detection_probability: 0.9
    dropouts: [{from_s: 0.2, to_s: 0.4}]
  roof: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, fov_deg: 200, max_range_m: 90}
  side: {type: radar, rate_hz: 5, measures: [azimuth, range], range_sigma_m: 0.3, azimuth_sigma_deg: 0.5}
trackers:
  raw: {use: raw}
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, sensors: [front, roof]}
  ukf: {filter: ukf, motion: {model: ctrv, acceleration_sigma_mps2: 3, yaw_acceleration_sigma_radps2: 1}}
monte_carlo: {runs: 2, seed: 7}
score: {settle_s: 0.1, divergence_m: 30, margin: {percent: 2}, reference: {acceleration_sigma_mps2: 2}}
expect:
  - {tracker: ekf, metric: position_rmse, below: 5}
  - {tracker: ekf, metric: position_rmse, better_than: raw}
recording: {run: 0}
"""
HIDDEN = """\
name: hidden
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  objects:
    car: {start: {x: 20, y: 5, speed_mps: 8, course_deg: 30}, pieces: [{for_s: 1}, {turn_rate_degps: 10}]}
    bus: {start: {x: 30, y: -4, vx_mps: -3}, length_m: 9, pieces: [{acceleration_mps2: 1}]}
sensing: {identities: hidden}
sensors:
  front:
    type: radar
    rate_hz: 10
    range_sigma_m: 0.3
    azimuth_sigma_deg: 0.5
    range_rate_sigma_mps: 0.1
    fov_deg: 120
    max_range_m: 80
    detection_probability: 0.9
    clutter: {per_scan: 3}
    occlusion: true
  roof: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, max_range_m: 60, latency_s: 0.1}
  camera:
    {type: radar, rate_hz: 5, measures: [azimuth], azimuth_sigma_deg: 0.1, max_range_m: 60, clutter: {per_scan: 1}}
trackers:
  gnn: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn, gate: 0.99, confirm: [2, 3]}}
  jipda: {filter: kf, motion: cv, acceleration_sigma_mps2: 3, sensors: [front, roof], associate: {method: jipda}}
  pmb: {filter: ukf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: pmb}}
monte_carlo: {runs: 2, seed: 7}
expect: [{tracker: gnn, metric: gospa, below: 20}]
"""
#: Of the cases that are valid, this share is run.
RUN = 0.3


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_mutated_scenarios(tried: Tried, tmp_path: Path, tiny_text: str) -> None:
    whole = "".join(EXAMPLES.values())
    file = tmp_path / "scenario.yaml"
    valid = 0
    for case in cases(50):
        chance = random.Random(case)
        text = chance.choice([whole, SCRIPTED, SCRIPTED, HIDDEN, HIDDEN, tiny_text])
        file.write_bytes(_mutated(chance, text, whole))
        overrides = _overrides(chance) if chance.random() < 0.2 else []
        if tried(case, "check", file) == 0:
            valid += 1
            if chance.random() < RUN:
                short = ["--runs", "1", "--set", "truth.duration_s=1", *overrides]
                writing = ["--no-recording"] if chance.random() < 0.8 else []
                tried(case, "run", file, *short, *writing, statuses=(0, 1, 2, 3))
    assert valid > 0


def _mutated(chance: random.Random, text: str, other: str) -> bytes:
    kind = chance.random()
    if kind < 0.6:
        tree = edited_tree(chance, yaml.safe_load(text))
        return _dumped(tree).encode("utf-8", "surrogatepass")
    if kind < 0.8:
        return edited_text(chance, text).encode("utf-8", "surrogatepass")
    return edited_bytes(chance, text.encode(), other.encode())


def _dumped(tree: Any) -> str:
    return yaml.safe_dump(tree, allow_unicode=True, sort_keys=False)


def _overrides(chance: random.Random) -> list[str]:
    keys = ["truth", "sensors", "front", "rate_hz", "trackers", "ekf", "0", "", "x", "expect", "metric", "score"]
    key = ".".join(chance.choice(keys) for _ in range(chance.randint(1, 3)))
    return ["--set", f"{key}={chance.choice(EXTREMES)}".replace("\x00", "")]

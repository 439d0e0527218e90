"""A small run whose identities are hidden: three cars, false alarms, a tracker that fails."""

from __future__ import annotations

from pathlib import Path

import pytest

import trackbench as tb
from trackbench.results import Result

TRAFFIC = """\
name: three_cars
description: Three cars, two of which leave
truth:
  source: scripted
  duration_s: 6
  rate_hz: 10
  observer: {x: 0, y: 0, yaw_deg: 0}
  objects:
    slow: {start: {x: 20, y: -4, vx_mps: 2}}
    fast: {start: {x: 10, y: 4, vx_mps: 10}}
    leaving: {start: {x: 30, y: 0, vx_mps: 12}}
sensing: {identities: hidden}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1,
          max_range_m: 60, detection_probability: 0.7, clutter: {per_scan: 8}}
trackers:
  gnn: &ekf {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}
  pmb: {<<: *ekf, associate: {method: pmb}}
  oracle: {<<: *ekf, associate: {method: oracle}}
  naive: {<<: *ekf, associate: {method: naive}}
monte_carlo: {runs: 3, seed: 7}
"""
FAILING = """\
class Failing:
    multi_object = True

    def step(self, state, scan):
        raise ValueError("out of order")
"""


@pytest.fixture(scope="session")
def traffic_text() -> str:
    """The scenario."""
    return TRAFFIC


@pytest.fixture(scope="session")
def traffic_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of its run."""
    folder = tmp_path_factory.mktemp("traffic")
    file = folder / "three_cars.yaml"
    file.write_text(TRAFFIC, encoding="utf-8")
    tb.run(file, out=folder)
    return folder / "three_cars"


@pytest.fixture(scope="session")
def traffic_result(traffic_folder: Path) -> Result:
    """Its result, as it was saved."""
    return Result.load(traffic_folder)


@pytest.fixture(scope="session")
def failing_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of the same scenario with a tracker that fails, and one alone that does not."""
    folder = tmp_path_factory.mktemp("failing")
    (folder / "failing_tracks.py").write_text(FAILING, encoding="utf-8")
    begin, end = TRAFFIC.index("  pmb:"), TRAFFIC.index("monte_carlo:")
    text = TRAFFIC[:begin] + '  failing: {use: "failing_tracks:Failing"}\n' + TRAFFIC[end:]
    (folder / "three_cars.yaml").write_text(text, encoding="utf-8")
    tb.run(folder / "three_cars.yaml", out=folder)
    return folder / "three_cars"


@pytest.fixture(scope="session")
def failing_result(failing_folder: Path) -> Result:
    """Its result."""
    return Result.load(failing_folder)

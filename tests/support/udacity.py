"""Lines in the format of the Udacity simulator, and a scenario to serve them with, for the tests."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
from tests.support.places import ROOT

RECORDING = "udacity/obj_pose-laser-radar-synthetic-input.txt"

SCENARIO = """
name: cyclist
truth: {source: recording, format: udacity, path: lines.txt}
sensors:
  lidar: {type: lidar, position_sigma_m: 0.15}
  radar: {type: radar, range_sigma_m: 0.3, azimuth_sigma_deg: 1.718873, range_rate_sigma_mps: 0.3}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: first_measurement}
  ekf_lidar: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: first_measurement, sensors: [lidar]}
  ukf: {filter: ukf, motion: ctrv, acceleration_sigma_mps2: 0.8, yaw_acceleration_sigma_radps2: 0.4,
        sigma_points: classic, initial: {from: two_measurements, least_time_s: 0}}
  cheat: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: truth}
  raising: {use: "serve_faults:Raising"}
  vanishing: {use: "serve_faults:Vanishing"}
monte_carlo: {runs: 1}
"""

FAULTS = '''
import numpy as np


class Constant:
    """Claims the origin until its third measurement, at which it fails."""

    def step(self, state, scan):
        count = (state or 0) + 1
        return count, self.third() if count == 3 else (np.zeros(4), np.eye(4))


class Raising(Constant):
    def third(self):
        raise ValueError("no third measurement, please")


class Vanishing(Constant):
    def third(self):
        return np.full(4, np.nan), np.eye(4)
'''


def write_scenario(folder: Path) -> Path:
    """The scenario, with the plug-ins that it names beside it, and without the recording."""
    (folder / "serve_faults.py").write_text(FAULTS)
    file = folder / "cyclist.yaml"
    file.write_text(SCENARIO)
    return file


def synthetic_lines(count: int = 80, seed: int = 3) -> list[str]:
    """Alternating measurements of a figure of eight around the origin, 50 ms apart."""
    random = np.random.default_rng(seed)
    time = 0.05 * np.arange(count)
    x, y = 12 * np.sin(0.3 * time + 1), 8 * np.sin(0.6 * time + 2)
    vx, vy = 3.6 * np.cos(0.3 * time + 1), 4.8 * np.cos(0.6 * time + 2)
    lines = []
    for k in range(count):
        truth = [x[k], y[k], vx[k], vy[k]]
        if k % 2 == 0:
            letter, measurement = "L", np.array([x[k], y[k]]) + random.normal(0, 0.15, 2)
        else:
            r = np.hypot(x[k], y[k])
            rate = (x[k] * vx[k] + y[k] * vy[k]) / r
            letter, measurement = "R", np.array([r, np.arctan2(y[k], x[k]), rate]) + random.normal(0, [0.3, 0.03, 0.3])
        stamp = 1477010443000000 + 50000 * k
        lines.append(
            "\t".join([letter, *map(repr, map(float, measurement)), str(stamp), *map(repr, map(float, truth))])
        )
    return lines


def recorded_lines() -> list[str] | None:
    """Those of the recording, where there is one."""
    file = data_folder() / RECORDING
    return file.read_text().splitlines() if file.is_file() else None


def data_folder() -> Path:
    """Where recordings are: TRACKBENCH_DATA, or shared/data beside the repository."""
    given = os.environ.get("TRACKBENCH_DATA")
    return Path(given) if given else ROOT.parent / "shared" / "data"


def telemetry(line: str) -> str:
    """The frame in which the simulator sends a line."""
    return "42" + json.dumps(["telemetry", {"sensor_measurement": line}])

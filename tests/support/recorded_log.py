"""Logs with known errors: scripted motion, measured by the bench's own sensors, written as a test car writes them."""

from __future__ import annotations

import csv
import functools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from trackbench.base.types import Truth
from trackbench.models.sensors import Lidar, Mount, Radar, Sensor
from trackbench.sensing.scans import ideal_sensors, sense_known
from trackbench.truth import Draw
from trackbench.truth.sources import ScriptedTruth

#: Objects that accelerate, turn and cross, so that every error of a sensor shows.
OBJECTS: dict[str, Any] = {
    "car": {
        "start": {"x": 25, "y": -6, "speed_mps": 9, "course_deg": 10},
        "pieces": [
            {"for_s": 6, "acceleration_mps2": 1.2},
            {"for_s": 8, "turn_rate_degps": 12},
            {"for_s": 8, "acceleration_mps2": -1.5, "turn_rate_degps": -15},
            {"for_s": 8, "acceleration_mps2": 1.5, "turn_rate_degps": 8},
        ],
    },
    "cyclist": {
        "start": {"x": 15, "y": 12, "speed_mps": 5, "course_deg": -60},
        "pieces": [{"for_s": 10, "turn_rate_degps": 25}, {"for_s": 20, "turn_rate_degps": -20}],
    },
    "van": {
        "start": {"x": 60, "y": 20, "speed_mps": 12, "course_deg": -150},
        "pieces": [
            {"for_s": 10, "acceleration_mps2": -0.8, "turn_rate_degps": 5},
            {"for_s": 20, "turn_rate_degps": -14, "acceleration_mps2": 0.3},
        ],
    },
}
#: An object that a sensor at rest cannot tell its clock from its place by.
STRAIGHT = {"car": {"start": {"x": 20, "y": 4, "speed_mps": 10, "course_deg": 0}, "pieces": [{"for_s": 30}]}}
#: Slow objects about a sensor at rest: in the time between two rows of the truth they go no further than its noise.
WALKERS = {
    name: {
        "start": {"x": x, "y": y, "speed_mps": 1.2, "course_deg": course},
        "pieces": [
            {"for_s": 10, "turn_rate_degps": turn},
            {"for_s": 10, "turn_rate_degps": -turn, "acceleration_mps2": 0.05},
            {"for_s": 10, "turn_rate_degps": 2 * turn},
        ],
    }
    for name, x, y, course, turn in (("a", 15, -5, 60, 12), ("b", 20, 6, -100, -15), ("c", 25, 0, 180, 10))
}
RADAR = {"range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1}
LIDAR = {"position_sigma_m": 0.15}
EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3}


@dataclass(frozen=True)
class Errors:
    """What is wrong with a sensor, and how it truly is."""

    time_offset_s: float = 0.0
    """To be added to its time stamps."""
    mount: Mapping[str, float] = field(default_factory=dict)
    """The true mount minus the stated one."""
    truly: Mapping[str, float] = field(default_factory=dict)
    """Keys of the sensor as it truly is: noise, detection probability."""
    biases: Mapping[str, float] = field(default_factory=dict)
    """Constant errors by component, in SI units and radians."""
    degrees: bool = False
    """The azimuth is in degrees where the scenario says radians."""


def write_log(
    folder: Path,
    *,
    seed: int = 0,
    duration_s: float = 30,
    objects: Mapping[str, Any] = OBJECTS,
    radar: Errors | None = Errors(),
    lidar: Errors | None = None,
    truth_hz: int = 20,
    moving: bool = True,
    form: str = "csv",
    mount: Mapping[str, float] = {"x_m": 2.0},
    truth_sigma_m: float = 0.0,
    truth_from: int = 0,
    truth_ahead_m: float = 0.0,
) -> Path:
    """Write a log, and a scenario that knows nothing of the errors; returns the scenario's file.

    ``truth_sigma_m`` is the noise of the truth's positions, white from row to row; ``truth_from`` the instant of the
    first row, in hundredths of a second, so that the truth's stamps are not those of the sensors. ``truth_ahead_m`` is
    how far the truth's point is in front of the measured one.
    """
    truth = _truth(duration_s, json.dumps(objects), moving)
    every, vx, vy = 100 // truth_hz, truth.vx, truth.vy
    noise = truth_sigma_m * np.random.default_rng([seed, 5]).normal(size=(2, *truth.px.shape[:2]))
    ahead = truth_ahead_m * np.array([np.cos(truth.heading), np.sin(truth.heading)])
    vx, vy = vx - truth.yaw_rate * ahead[1], vy + truth.yaw_rate * ahead[0]
    px, py = (
        at[:, :, 0] for at in (truth.px + ahead[0] + noise[0, ..., None], truth.py + ahead[1] + noise[1, ..., None])
    )
    rows = [
        [truth.time[k], name, px[k, i], py[k, i], vx[k, i, 0], vy[k, i, 0]]
        for k in range(truth_from, len(truth.time), every)
        for i, name in enumerate(truth.ids)
    ]
    write_table(folder / f"truth.{form}", ["t", "who", "x", "y", "vx", "vy"], rows)
    ego = truth.observer
    rows = [[truth.time[k], ego.px[k], ego.py[k], ego.yaw[k]] for k in range(0, len(truth.time), 2)]
    write_table(folder / f"ego.{form}", ["t", "x", "y", "yaw"], rows)
    columns = {"time": "t", "object": "who", "px": "x", "py": "y", "vx": "vx", "vy": "vy"}
    observer = {"path": f"ego.{form}", "px": "x", "py": "y", "yaw": "yaw"}
    sensors, readings = {}, {}
    for name, errors, kind, stated in (("radar", radar, Radar, RADAR), ("lidar", lidar, Lidar, LIDAR)):
        if errors is None:
            continue
        rows = _measured(truth, name, kind, {**stated, **errors.truly}, mount, errors, seed)
        write_table(folder / f"{name}.{form}", ["t", "who", *kind.components], rows)
        sensors[name] = {"type": name, "mount": dict(mount), **stated}
        readings[name] = {"path": f"{name}.{form}", **{component: component for component in kind.components}}
    scenario = {
        "name": "own_log",
        "truth": {
            "source": "recording",
            "format": form,
            "path": f"truth.{form}",
            "columns": columns,
            "ego": observer,
            "readings": readings,
        },
        "sensors": sensors,
        "trackers": {"ekf": EKF},
        "monte_carlo": {"runs": 1},
    }
    file = folder / "log.yaml"
    file.write_text(yaml.safe_dump(scenario, sort_keys=False), encoding="utf-8")
    return file


def write_table(file: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """As CSV or Parquet, by the ending."""
    if file.suffix == ".parquet":
        cells = [list(column) for column in zip(*rows, strict=True)] or [[] for _ in head]
        pq.write_table(pa.table(dict(zip(head, cells, strict=True))), file)
        return
    with file.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([head, *rows])


@functools.cache
def _truth(duration_s: float, objects: str, moving: bool) -> Truth:
    observer = {"x": 0, "y": 0, "yaw_deg": 20}
    if moving:
        observer |= {"vx_mps": 3, "vy_mps": 1, "turn_rate_degps": 4}
    source = {
        "source": "scripted",
        "duration_s": duration_s,
        "rate_hz": 100,
        "observer": observer,
        "objects": json.loads(objects),
    }
    return ScriptedTruth.model_validate(source).load(Draw(0, "log", 1), folder=Path()).truth


def _measured(
    truth: Truth,
    name: str,
    kind: type[Sensor],
    keys: Mapping[str, float],
    mount: Mapping[str, float],
    errors: Errors,
    seed: int,
) -> list[list[Any]]:
    true_mount = Mount(**{key: mount.get(key, 0.0) + errors.mount.get(key, 0.0) for key in {*mount, *errors.mount}})
    config = kind(rate_hz=20 if kind is Radar else 10, mount=true_mount, **keys)
    rows = []
    for scan in sense_known(ideal_sensors(truth, {name: config}), seed, "log", range(1)).scans:
        for i, who in enumerate(truth.ids):
            if scan.valid[i]:
                values = [
                    value + errors.biases.get(component, 0.0)
                    for component, value in zip(kind.components, scan.measurement[:, i].tolist(), strict=True)
                ]
                if errors.degrees:
                    values[1] = float(np.rad2deg(values[1]))
                rows.append([scan.time - errors.time_offset_s, who, *values])
    return rows

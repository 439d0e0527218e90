"""Scenarios that are exported, and scenarios written down as a test car writes them: boxes, ego motion, detections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from tests.support.recorded_log import write_table

from trackbench.base.types import Truth
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.detections import FALSE_ALARM, sense_hidden
from trackbench.sensing.scans import Measurements, ideal_sensors

SCENARIO = """\
name: exported
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  observer: {x: 1, y: 2, yaw_deg: 30, vx_mps: 3, vy_mps: 1, turn_rate_degps: 4}
  objects:
    car: {start: {x: 25, y: -6, speed_mps: 9, course_deg: 10}, pieces: [{for_s: 2, turn_rate_degps: 12}]}
    cyclist: {start: {x: 15, y: 12, speed_mps: 5, course_deg: -60}, pieces: [{for_s: 2}]}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1,
          max_range_m: 60, detection_probability: 0.5, latency_s: [0, 0.25]}
  lidar: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, detection_probability: 0.3}
trackers:
  raw: {use: raw}
monte_carlo: {runs: 3, seed: 7}
"""
HIDDEN = SCENARIO.replace("trackers:", "sensing: {identities: hidden}\ntrackers:").replace(
    "{use: raw}", "{filter: ekf, motion: cv, acceleration_sigma_mps2: 3, associate: {method: gnn}}"
)
HIDDEN = HIDDEN.replace("latency_s", "clutter: {per_scan: 0.5}, latency_s")


BOXES = ["t", "who", "type", "x", "y", "vx", "vy", "yaw", "length", "width"]
EGO = ["t", "x", "y", "vx", "vy", "yaw", "yaw_rate"]
COLUMNS = {
    "time": "t",
    "object": "who",
    "class": "type",
    "px": "x",
    "py": "y",
    "vx": "vx",
    "vy": "vy",
    "heading": "yaw",
    "length": "length",
    "width": "width",
}
OBSERVER = {key: key.removeprefix("p") for key in ("px", "py", "vx", "vy")} | {key: key for key in ("yaw", "yaw_rate")}
#: Keys of a sensor that a recording does not have.
SYNTHETIC = ("rate_hz", "detection_probability", "clutter", "phase_s")


def write_scenes(folder: Path, loaded: Scenario, *, labelled: bool = False, **changes: Any) -> tuple[Path, list[Any]]:
    """Write the first run of each scene as a log of its own, and the scenario of all; with what was measured."""
    truths, config = truths_of(loaded), loaded.config
    readings: dict[str, Any] = {name: {} for name in config.sensors}
    made = []
    for scene, item in enumerate(truths):
        sensors = ideal_sensors(item.truth, config.sensors, item.measurements)
        noise = config.name if scene == 0 else f"{config.name}, scene {scene}"
        hidden = sense_hidden(sensors, config.monte_carlo.seed, noise, range(1))
        made.append((item.truth, hidden))
        write_truth(folder, f"{scene:02}", item.truth)
        for name in config.sensors:
            write_detections(folder / f"{scene:02}_{name}.csv", name, item.truth, hidden, labelled=labelled)
    sensors_left = {}
    for name, sensor in yaml.safe_load(loaded.text)["sensors"].items():
        states = {
            "detection_probability": sensor.get("detection_probability", 1.0),
            "clutter_per_scan": float(sensor.get("clutter", {}).get("per_scan", 0)),
        }
        sensors_left[name] = {key: value for key, value in sensor.items() if key not in SYNTHETIC}
        sensors_left[name]["states"] = {**states, **sensor.get("states", {})}
        components = {component: component for component in type(config.sensors[name]).components}
        paths = [f"{scene:02}_{name}.csv" for scene in range(len(truths))]
        readings[name] = {"path": paths, **components, **({"object": "who"} if labelled else {})}
    paths = [f"{scene:02}_ego.csv" for scene in range(len(truths))]
    content = {
        "name": config.name,
        "truth": {
            "source": "recording",
            "format": "csv",
            "path": [f"{scene:02}_boxes.csv" for scene in range(len(truths))],
            "columns": COLUMNS,
            "ego": {**OBSERVER, "path": paths},
            "readings": readings,
            "reference": {"classes": ["car"]},
            **changes,
        },
        "sensing": {"identities": "hidden"},
        "sensors": sensors_left,
        "trackers": yaml.safe_load(loaded.text)["trackers"],
        "monte_carlo": {"runs": 1, "seed": config.monte_carlo.seed},
    }
    file = folder / "log.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file, made


def write_truth(folder: Path, name: str, truth: Truth) -> None:
    """Boxes of all objects while they are there, and the motion of the observer, to the last digit."""
    values = [truth.px, truth.py, truth.vx, truth.vy, truth.heading]
    sizes = np.stack([truth.length, truth.width]).T.tolist()
    kinds = ["car" if target else "other" for target in truth.target]
    rows = [
        [truth.time[k], who, kinds[i], *(float(v[k, i, 0]) for v in values), *sizes[i]]
        for k in range(len(truth.time))
        for i, who in enumerate(truth.ids)
        if truth.alive[k, i]
    ]
    write_table(folder / f"{name}_boxes.csv", BOXES, rows)
    ego = truth.observer
    motion = np.stack([truth.time, ego.px, ego.py, ego.vx, ego.vy, ego.yaw, ego.yaw_rate])
    write_table(folder / f"{name}_ego.csv", EGO, motion.T.tolist())


def write_detections(file: Path, sensor: str, truth: Truth, hidden: Measurements, *, labelled: bool) -> None:
    """The detections of a sensor, and an empty row for each scan without one; labels leave false alarms empty."""
    names = [*truth.ids, ""]
    rows: list[list[Any]] = []
    head: list[str] = []
    for scan, origins in zip(hidden.scans, hidden.origins, strict=True):
        if scan.sensor != sensor:
            continue
        size = len(scan.noise_covariance)
        columns = np.flatnonzero(scan.valid[:, 0]).tolist()
        for column in columns:
            who = names[origins[column, 0]] if origins[column, 0] != FALSE_ALARM else ""
            rows.append([scan.time, *([who] if labelled else []), *scan.measurement[:, column, 0].tolist()])
        if not columns:
            rows.append([scan.time, *([""] if labelled else []), *[""] * size])
        head = ["t", *(["who"] if labelled else []), *components_of(scan.kind)]
    write_table(file, head, rows)


def components_of(kind: str) -> tuple[str, ...]:
    from trackbench.models.sensors import SENSOR_MODELS

    return SENSOR_MODELS[kind].components

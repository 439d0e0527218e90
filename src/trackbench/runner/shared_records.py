"""Records of the tables that every run has (motion, roads), and the keys that records of scans and runs share."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.base.types import Scan, Truth, of_runs
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.results.columns import Record
from trackbench.results.folder import OBSERVER
from trackbench.runner.work import Work

#: Records of each table, by name of the table.
Records = dict[str, list[Record]]
#: Column of each field of a truth's motion.
_MOTION = {
    "px": "px_m",
    "py": "py_m",
    "heading": "heading_rad",
    "course": "course_rad",
    "speed": "speed_mps",
    "vx": "vx_mps",
    "vy": "vy_mps",
    "acceleration": "acceleration_mps2",
    "yaw_rate": "yaw_rate_radps",
}


def truth_records(truth: Truth, run: int) -> list[Record]:
    """Return the true motion of every target, one record each, and of the observer, in one run."""
    # Some fields are computed at each access, for all objects at once.
    fields = {name: of_runs(getattr(truth, field), range(run, run + 1))[..., 0] for field, name in _MOTION.items()}
    records: list[Record] = [
        {
            "object": target,
            "role": "target",
            "time_s": truth.time,
            "alive": truth.alive[:, i],
            **{name: values[:, i] for name, values in fields.items()},
            "length_m": float(truth.length[i]),
            "width_m": float(truth.width[i]),
        }
        for i, target in enumerate(truth.ids)
    ]
    observer, steps = truth.observer, len(truth.time)
    speed = np.hypot(observer.vx, observer.vy)
    records.append(
        {
            "object": OBSERVER,
            "role": OBSERVER,
            "time_s": truth.time,
            "alive": np.ones(steps, dtype=bool),
            **{_MOTION[field]: getattr(observer, field) for field in ("px", "py", "vx", "vy", "yaw_rate")},
            "heading_rad": observer.yaw,
            "course_rad": np.where(speed > 0, np.arctan2(observer.vy, observer.vx), observer.yaw),
            "speed_mps": speed,
            "acceleration_mps2": np.gradient(speed, truth.time) if steps > 1 else np.zeros(steps),
            "length_m": float(observer.length),
            "width_m": float(observer.width),
        }
    )
    return records


def other_truth(work: Work) -> Records:
    """Return the true motion of each scene but that of the recorded run (kept for plots), in the run of its number."""
    records: list[Record] = [
        {**record, "scene": float(number)}
        for number, scene in enumerate(work.scenes)
        if number != work.recorded_scene and scene.truth.known
        for record in truth_records(scene.truth, work.recorded_run)
    ]
    return {"other_truth": records} if records else {}


def road_records(truth: Truth) -> list[Record]:
    """Return one record for each lane edge: its number and the x, y of its points, m."""
    lines = truth.roads or [np.zeros((0, 2))]
    return [{"line": float(i), "x_m": line[:, 0], "y_m": line[:, 1]} for i, line in enumerate(lines)]


def run_keys(name: str, work: Work) -> Record:
    scene = work.scene_of_run
    return {"tracker": name, "run": np.arange(len(scene), dtype=float), "scene": scene.astype(float)}


def scan_record(scan: Scan) -> dict[str, Any]:
    """Return a scan's measurements ``(m, rows)`` as columns, with the position that each one states."""
    return {
        "sensor": scan.sensor,
        "kind": scan.kind,
        "time_s": float(scan.time),
        **{f"z{row}": scan.measurement[row] if row < len(scan.measurement) else np.nan for row in range(3)},
        **dict(zip(("x_m", "y_m"), SENSOR_MODELS[scan.kind].position(scan).mean, strict=False)),
        **dict(zip(("sensor_x_m", "sensor_y_m", "sensor_yaw_rad"), scan.sensor_pose, strict=True)),
    }

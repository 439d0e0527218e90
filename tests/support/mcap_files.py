"""Logs and tracks in MCAP: the scenario that reads what an export has written, and tracks as messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from trackbench.subjects.export.mcap import SCHEMAS, STAMP, mcap_messages, schema_of, stamp_of
from trackbench.truth.recorded.foxglove import TRACKS
from trackbench.truth.tracks import TrackRows

MOUNTS = {"radar": {"x_m": 2, "y_m": -0.5, "yaw_deg": 10}, "lidar": {"yaw_deg": -30}}
COMPONENTS = {"radar": ("range", "azimuth", "range_rate"), "lidar": ("x", "y")}
UNITS = {"range": "m", "azimuth": "rad", "range_rate": "mps", "x": "m", "y": "m"}


def mounted(text: str) -> dict[str, Any]:
    """A scenario whose scans are taken from two places on the observer, and come at once."""
    content: dict[str, Any] = yaml.safe_load(text.replace(", latency_s: [0, 0.25]", ""))
    for name, mount in MOUNTS.items():
        content["sensors"][name]["mount"] = mount
    return content


def log_of(content: dict[str, Any], *, hidden: bool, run: int = 1) -> dict[str, Any]:
    """The scenario that reads what was exported of a run."""
    scans = f"scans/scene0_run{run}.mcap"
    sensors, readings = {}, {}
    for name, components in COMPONENTS.items():
        kept = ("type", "mount", "range_sigma_m", "azimuth_sigma_deg", "range_rate_sigma_mps", "position_sigma_m")
        sensors[name] = {key: content["sensors"][name][key] for key in kept if key in content["sensors"][name]}
        readings[name] = {"path": scans, "topic": f"/{name}/detections", **{part: part for part in components}}
        if not hidden:
            own = {part: f"{part}_{UNITS[part]}" for part in components}
            readings[name] |= {"topic": f"/{name}/scan", "object": "object", **own}
    columns = {"vx": "vx_mps", "vy": "vy_mps", "observer": {"path": scans, "frame": "observer"}}
    truth = {"source": "recording", "format": "mcap", "path": "truth/scene0.mcap"}
    return {
        **{key: content[key] for key in ("name", "sensing", "trackers") if key in content},
        "truth": {**truth, "columns": columns, "readings": readings},
        "sensors": sensors,
        "monte_carlo": {"runs": 1},
    }


SCHEMAS[TRACKS] = schema_of(
    {
        "time_s": float,
        "tracks": [{"id": str, "mean": [float] * 4, "covariance?": [[float] * 4] * 4, "existence?": float}],
        "timestamp?": STAMP,
        "scene?": str,
        "run?": str,
        "fingerprint?": str,
    }
)


def write_tracks(rows: TrackRows, path: Path) -> None:
    """Tracks as ``trackbench.Tracks``, one message for each time; of several runs for each time and run."""
    keys = {name: getattr(rows, name) for name in ("scene", "run", "fingerprint") if getattr(rows, name) is not None}
    groups: dict[tuple[Any, ...], list[int]] = {}
    for row, time in enumerate(rows.time.tolist()):
        groups.setdefault((*(column[row] for column in keys.values()), time), []).append(row)
    with mcap_messages(path) as write:
        for (*of_run, time), members in groups.items():
            tracks = [_track(rows, row) for row in members]
            message = {
                **dict(zip(keys, of_run, strict=True)),
                "time_s": time,
                "timestamp": stamp_of(time),
                "tracks": tracks,
            }
            write("/tracks", TRACKS, time, message)


def _track(rows: TrackRows, row: int) -> dict[str, Any]:
    mean = [rows.px, rows.py, rows.vx, rows.vy]
    track: dict[str, Any] = {"id": rows.id[row], "mean": [float(part[row]) for part in mean if part is not None]}
    if rows.covariance is not None:
        values = rows.covariance[..., row].tolist()
        track["covariance"] = [[None if np.isnan(entry) else entry for entry in line] for line in values]
    if rows.existence is not None and np.isfinite(rows.existence[row]):
        track["existence"] = float(rows.existence[row])
    return track

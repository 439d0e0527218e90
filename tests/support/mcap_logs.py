"""The scenario that reads what an export in MCAP has written."""

from __future__ import annotations

from typing import Any

import yaml

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

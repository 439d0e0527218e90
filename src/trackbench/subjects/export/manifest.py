"""The file ``manifest.json``: the contents of an export's folder, and the meaning of its numbers."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from typing import Any

import numpy as np

from trackbench.runner.assemble import scene_fingerprint
from trackbench.scenario import Scenario
from trackbench.sensing.detections import stated_detection
from trackbench.sensing.scans import IdealSensor, scan_rate
from trackbench.sensing.view import field_of_view
from trackbench.subjects.export.scans import TRUTH, ScanSource, component_columns, scan_columns

MANIFEST = "manifest.json"
#: Version of the manifest and of the tables that it describes.
SCHEMA_VERSION = 1
FRAME = (
    "x and y in the plane of the road, fixed to the ground; angles counter-clockwise seen from above; SI units and rad"
)


def scan_manifest(source: ScanSource) -> dict[str, Any]:
    """Return the contents of ``manifest.json`` for scans: scenario, scenes, sensors, fingerprints and columns."""
    config, hidden = source.loaded.config, source.hidden
    scenes = [_scene(source, number) for number in range(len(source.truths))]
    if not hidden:
        for number, scene in enumerate(scenes):
            scene["objects"] = list(source.truths[number].truth.ids)
    return {
        **_head("scans", source.loaded),
        "seed": config.monte_carlo.seed,
        "runs": config.monte_carlo.runs,
        "identities": config.sensing.identities,
        "frame": FRAME,
        "scenes": scenes,
        "sensors": {sensor.name: _sensor(sensor, hidden) for sensor in source.work.scenes[0].sensors},
        "fingerprints": [{**key._asdict(), "fingerprint": text} for key, text in source.fingerprints.items()],
        "columns": scan_columns(config.sensors, hidden),
    }


def truth_manifest(source: ScanSource) -> dict[str, Any]:
    """Return the contents of ``manifest.json`` for ground truth: scenario, frame, scenes and columns."""
    scenes = [_scene(source, number) for number in range(len(source.truths))]
    return {**_head("truth", source.loaded), "frame": FRAME, "scenes": scenes, "columns": TRUTH}


def _head(content: str, loaded: Scenario) -> dict[str, Any]:
    scenario = {
        "name": loaded.config.full_name,
        "sha256": hashlib.sha256(loaded.text.encode()).hexdigest(),
        "overrides": list(loaded.overrides),
    }
    return {
        "content": content,
        "schema_version": SCHEMA_VERSION,
        "trackbench": version("trackbench"),
        "scenario": scenario,
    }


def _scene(source: ScanSource, number: int) -> dict[str, Any]:
    truth = source.truths[number].truth
    return {
        "scene": number,
        "name": source.scene_names[number],
        "duration_s": float(truth.time[-1]),
        "motion": scene_fingerprint(truth, source.truths[number].measurements),
    }


def _sensor(sensor: IdealSensor, hidden: bool) -> dict[str, Any]:
    """Return a sensor's stated properties."""
    config, view = sensor.config, field_of_view(sensor.config)
    names = zip(config.components, component_columns(config), config.units, strict=True)
    entry: dict[str, Any] = {
        "kind": config.type,
        "components": [
            {"name": name, "column": column, "unit": unit, "angular": number in config.angular}
            for number, (name, column, unit) in enumerate(names)
        ],
        "noise_covariance": sensor.noise_covariance.tolist(),
        "rate_hz": scan_rate(sensor),
        "mount": config.mount.model_dump(),
        "latency_s": list(config.latency),
        "field_of_view": {
            "half_angle_rad": view.half_angle,
            "max_range_m": view.max_range if np.isfinite(view.max_range) else None,
            "volume": view.volume,
        },
    }
    if hidden:
        entry["detection_probability"], entry["clutter_density"] = stated_detection(config)
        entry["half_range_m"] = config.states.half_range_m
    return entry

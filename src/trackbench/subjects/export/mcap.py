"""Scans and truths in MCAP, as JSON: Foxglove's schemas for viewers, the bench's own for programs."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Scan, Truth
from trackbench.models.sensors import SENSOR_MODELS, Mount
from trackbench.subjects.export.scans import RunKey, ScanSource, component_columns
from trackbench.truth.formats.mcap import BOXES, POINTS, SCAN, TRANSFORMS

TYPES = {float: "number", int: "integer", str: "string", bool: "boolean"}
STAMP = {"sec": int, "nsec": int}
VECTOR = {"x": float, "y": float, "z": float}
ROTATION = VECTOR | {"w": float}
POSE = {"position": VECTOR, "orientation": ROTATION}
COLOUR = {"r": float, "g": float, "b": float, "a": float}
CUBE = {"pose": POSE, "size": VECTOR, "color": COLOUR}
BOX = {"timestamp": STAMP, "frame_id": str, "id": str, "lifetime": STAMP, "frame_locked": bool}
TRANSFORM = {"timestamp": STAMP, "parent_frame_id": str, "child_frame_id": str, "translation": VECTOR}


def schema_of(shape: Any) -> dict[str, Any]:
    """Return the JSON schema of a shape.

    A shape is a type, a list of one item or of a fixed number of equal ones, a dict whose keys with a question mark may
    be missing, or a tuple of a shape and what else its schema says.
    """
    if isinstance(shape, tuple):
        return {**schema_of(shape[0]), **shape[1]}
    if isinstance(shape, list):
        count = {"minItems": len(shape), "maxItems": len(shape)} if len(shape) > 1 else {}
        return {"type": "array", "items": schema_of(shape[0]), **count}
    if isinstance(shape, dict):
        properties = {name.rstrip("?"): schema_of(item) for name, item in shape.items()}
        required = [name for name in shape if not name.endswith("?")]
        return {"type": "object", "properties": properties, "required": required}
    return {"type": TYPES[shape]}


SCHEMAS = {
    BOXES: schema_of(
        {
            "deletions": [{"timestamp": STAMP, "type": int, "id": str}],
            "entities": [BOX | {"metadata": [{"key": str, "value": str}], "cubes": [CUBE]}],
        }
    ),
    TRANSFORMS: schema_of({"transforms": [TRANSFORM | {"rotation": ROTATION}]}),
    POINTS: schema_of(
        {
            "timestamp": STAMP,
            "frame_id": str,
            "pose": POSE,
            "point_stride": int,
            "fields": [{"name": str, "offset": int, "type": int}],
            "data": (str, {"contentEncoding": "base64"}),
        }
    ),
    SCAN: schema_of(
        {
            "scene": int,
            "run": int,
            "fingerprint": str,
            "scan": int,
            "sensor": str,
            "timestamp": STAMP,
            "time_s": float,
            "arrival_time_s": float,
            "sensor_pose": ([float] * 3, {"description": "x m, y m, yaw rad in the fixed frame"}),
            "sensor_velocity": ([float] * 2, {"description": "vx, vy in the fixed frame, m/s"}),
            "noise_covariance": [[float]],
            "rows": [{"valid": bool, "object?": str, "detection?": int}],
            "detection_probability?": float,
            "clutter_density?": float,
        }
    ),
}


#: The frame that is fixed to the ground, and that of what carries the sensors.
FIXED, OBSERVER = "world", "observer"
#: ``foxglove.NumericType``
FLOAT64 = 8
#: Height of boxes, which nothing states, m.
HEIGHT = 1.5
GREY = {"r": 0.5, "g": 0.5, "b": 0.5, "a": 0.6}

#: ``(topic, schema, log time s, message)``
Write = Callable[[str, str, float, Any], None]


def mcap_scan_files(source: ScanSource) -> dict[str, Callable[[Path], object]]:
    """Return what writes the file of each run."""
    return {f"{key.stem}.mcap": partial(_write_scans, source, key) for key in source.keys}


def mcap_truth_files(source: ScanSource) -> dict[str, Callable[[Path], object]]:
    """Return what writes the file of each scene; where motion is drawn anew, of each run."""
    return {f"{name}.mcap": partial(_write_truth, truth, run) for name, truth, run in source.truth_runs()}


def _write_scans(source: ScanSource, key: RunKey, path: Path) -> None:
    of_run = source.scans(key)
    common = {**key._asdict(), "fingerprint": of_run.fingerprint}
    mounts = {name: sensor.mount for name, sensor in source.loaded.config.sensors.items()}
    with mcap_messages(path) as write:
        for number, scan in enumerate(of_run.scans):
            arrival = scan.arrival_time
            write("/tf", TRANSFORMS, arrival, {"transforms": _transforms(scan, mounts[scan.sensor])})
            write(f"/{scan.sensor}/detections", POINTS, arrival, _point_cloud(scan))
            message = {**common, "scan": number, **_scan(scan, of_run.objects)}
            write(f"/{scan.sensor}/scan", SCAN, arrival, message)


def _write_truth(truth: Truth, run: int, path: Path) -> None:
    with mcap_messages(path) as write:
        for step, time in enumerate(truth.time.tolist()):
            bodies = np.flatnonzero(truth.alive[step]).tolist()
            entities = [_entity(truth, step, body, run) for body in bodies]
            write("/truth", BOXES, time, {"deletions": [], "entities": entities})


@contextmanager
def mcap_messages(path: Path) -> Iterator[Write]:
    """Open a new file, and yield what writes a message.

    Raises:
        InputError: the package is missing.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError("MCAP needs one more package: pip install 'trackbench[mcap]'", file=path.name) from None
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(library="trackbench")
        channels: dict[str, int] = {}
        schemas: dict[str, int] = {}

        def write(topic: str, schema: str, time: float, message: Any) -> None:
            if schema not in schemas:
                content = json.dumps({"title": schema, **SCHEMAS[schema]}).encode()
                schemas[schema] = writer.register_schema(name=schema, encoding="jsonschema", data=content)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, message_encoding="json", schema_id=schemas[schema])
            data = json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
            nanoseconds = round(time * 1e9)
            writer.add_message(channels[topic], log_time=nanoseconds, data=data, publish_time=nanoseconds)

        yield write
        writer.finish()  # type: ignore[no-untyped-call]


def stamp_of(time: float) -> dict[str, int]:
    """Return a time in s as seconds and nanoseconds."""
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _rotation(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(yaw / 2)), "w": float(np.cos(yaw / 2))}


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": float(x), "y": float(y), "z": z}


def _transforms(scan: Scan, mount: Mount) -> list[dict[str, Any]]:
    """Return the poses of the observer in the fixed frame and of the sensor on it."""
    x, y, yaw = scan.sensor_pose
    heading = yaw - np.radians(mount.yaw_deg)
    cos, sin = np.cos(heading), np.sin(heading)
    place = x - cos * mount.x_m + sin * mount.y_m, y - sin * mount.x_m - cos * mount.y_m
    poses = (FIXED, OBSERVER, *place, heading), (OBSERVER, scan.sensor, mount.x_m, mount.y_m, np.radians(mount.yaw_deg))
    return [
        {
            "timestamp": stamp_of(scan.time),
            "parent_frame_id": parent,
            "child_frame_id": child,
            "translation": _vector(ahead, left),
            "rotation": _rotation(float(turned)),
        }
        for parent, child, ahead, left, turned in poses
    ]


def _point_cloud(scan: Scan) -> dict[str, Any]:
    """Return the detections of a scan in the sensor's frame: x, y, z and each component of the measurement."""
    model = SENSOR_MODELS[scan.kind]
    measurement = scan.measurement[:, scan.valid]
    dx, dy = model.position(scan._replace(measurement=measurement)).mean - scan.sensor_pose[:2, None]
    cos, sin = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
    points: dict[str, Array] = {"x": cos * dx + sin * dy, "y": cos * dy - sin * dx, "z": np.zeros_like(dx)}
    points |= dict(zip(model.components, measurement, strict=True))
    return {
        "timestamp": stamp_of(scan.time),
        "frame_id": scan.sensor,
        "pose": {"position": _vector(0.0, 0.0), "orientation": _rotation(0.0)},
        "point_stride": 8 * len(points),
        "fields": [{"name": name, "offset": 8 * place, "type": FLOAT64} for place, name in enumerate(points)],
        "data": base64.b64encode(np.stack([*points.values()], axis=-1).astype("<f8").tobytes()).decode(),
    }


def _scan(scan: Scan, objects: tuple[str, ...] | None) -> dict[str, Any]:
    """Return all that a tracker gets of a scan."""
    columns = component_columns(SENSOR_MODELS[scan.kind])
    rows = []
    for number, (valid, measured) in enumerate(zip(scan.valid.tolist(), scan.measurement.T.tolist(), strict=True)):
        row: dict[str, Any] = {"detection": number} if objects is None else {"object": objects[number]}
        rows.append(row | {"valid": valid} | (dict(zip(columns, measured, strict=True)) if valid else {}))
    stated = {}
    if objects is None:
        stated = {"detection_probability": scan.detection_probability, "clutter_density": scan.clutter_density}
    return {
        "sensor": scan.sensor,
        "timestamp": stamp_of(scan.time),
        "time_s": scan.time,
        "arrival_time_s": scan.arrival_time,
        "sensor_pose": scan.sensor_pose.tolist(),
        "sensor_velocity": scan.sensor_velocity.tolist(),
        "noise_covariance": scan.noise_covariance.tolist(),
        **stated,
        "rows": rows,
    }


def _entity(truth: Truth, step: int, body: int, run: int) -> dict[str, Any]:
    """Return a body as a box, with its velocity as metadata."""
    at = step, body, run
    metadata = {
        "vx_mps": repr(float(truth.vx[at])),
        "vy_mps": repr(float(truth.vy[at])),
        "target": str(int(truth.target[body])),
    }
    cube = {
        "pose": {
            "position": _vector(truth.px[at], truth.py[at], HEIGHT / 2),
            "orientation": _rotation(float(truth.heading[at])),
        },
        "size": _vector(truth.length[body], truth.width[body], HEIGHT),
        "color": GREY,
    }
    nothing: dict[str, list[Any]] = {
        name: [] for name in ("arrows", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    }
    return {
        "timestamp": stamp_of(float(truth.time[step])),
        "frame_id": FIXED,
        "id": truth.ids[body],
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": value} for key, value in metadata.items()],
        "cubes": [cube],
        **nothing,
    }

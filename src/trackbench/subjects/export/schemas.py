"""JSON schemas of the messages in MCAP: the parts of Foxglove's that are written, and the bench's own."""

from __future__ import annotations

from typing import Any

from trackbench.truth.recorded.foxglove import BOXES, POINTS, SCAN, TRANSFORMS

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
    """The JSON schema of a type; of a list of an item, of two or more so many; of a dict of which keys with a question
    mark may be missing; and of a tuple of such a shape and what else the schema says of it."""
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

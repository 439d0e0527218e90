"""JSON schemas of the messages in MCAP: the parts of Foxglove's that are written, and the bench's own."""

from __future__ import annotations

from typing import Any

from trackbench.truth.recorded.foxglove import BOXES, POINTS, SCAN, TRACKS, TRANSFORMS

NUMBER, WHOLE, TEXT = {"type": "number"}, {"type": "integer"}, {"type": "string"}


def _object(required: dict[str, Any], optional: dict[str, Any] | None = None) -> dict[str, Any]:
    return {"type": "object", "properties": required | (optional or {}), "required": [*required]}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _numbers(count: int) -> dict[str, Any]:
    return _list(NUMBER) | {"minItems": count, "maxItems": count}


STAMP = _object({"sec": WHOLE, "nsec": WHOLE})
VECTOR = _object({"x": NUMBER, "y": NUMBER, "z": NUMBER})
ROTATION = _object({"x": NUMBER, "y": NUMBER, "z": NUMBER, "w": NUMBER})
POSE = _object({"position": VECTOR, "orientation": ROTATION})
COLOUR = _object({"r": NUMBER, "g": NUMBER, "b": NUMBER, "a": NUMBER})
CUBE = _object({"pose": POSE, "size": VECTOR, "color": COLOUR})
OF_RUN = {"scene": WHOLE, "run": WHOLE, "fingerprint": TEXT}

SCHEMAS: dict[str, dict[str, Any]] = {
    BOXES: _object(
        {
            "deletions": _list(_object({"timestamp": STAMP, "type": WHOLE, "id": TEXT})),
            "entities": _list(
                _object(
                    {
                        "timestamp": STAMP,
                        "frame_id": TEXT,
                        "id": TEXT,
                        "lifetime": STAMP,
                        "frame_locked": {"type": "boolean"},
                        "metadata": _list(_object({"key": TEXT, "value": TEXT})),
                        "cubes": _list(CUBE),
                    }
                )
            ),
        }
    ),
    TRANSFORMS: _object(
        {
            "transforms": _list(
                _object(
                    {
                        "timestamp": STAMP,
                        "parent_frame_id": TEXT,
                        "child_frame_id": TEXT,
                        "translation": VECTOR,
                        "rotation": ROTATION,
                    }
                )
            )
        }
    ),
    POINTS: _object(
        {
            "timestamp": STAMP,
            "frame_id": TEXT,
            "pose": POSE,
            "point_stride": WHOLE,
            "fields": _list(_object({"name": TEXT, "offset": WHOLE, "type": WHOLE})),
            "data": TEXT | {"contentEncoding": "base64"},
        }
    ),
    SCAN: _object(
        {
            **OF_RUN,
            "scan": WHOLE,
            "sensor": TEXT,
            "timestamp": STAMP,
            "time_s": NUMBER,
            "arrival_time_s": NUMBER,
            "sensor_pose": _numbers(3) | {"description": "x m, y m, yaw rad in the fixed frame"},
            "sensor_velocity": _numbers(2) | {"description": "vx, vy in the fixed frame, m/s"},
            "noise_covariance": _list(_list(NUMBER)),
            "rows": _list(_object({"valid": {"type": "boolean"}}, {"object": TEXT, "detection": WHOLE})),
        },
        {"detection_probability": NUMBER, "clutter_density": NUMBER},
    ),
    TRACKS: _object(
        {
            "time_s": NUMBER,
            "tracks": _list(
                _object(
                    {
                        "id": {"type": ["string", "integer"]},
                        "mean": _numbers(4) | {"description": "px, py m, vx, vy m/s"},
                    },
                    {
                        "covariance": _list(_list({"type": ["number", "null"]}))
                        | {"description": "4 by 4, of the mean"},
                        "existence": NUMBER | {"minimum": 0, "maximum": 1},
                    },
                )
            ),
        },
        {
            "timestamp": STAMP,
            "scene": {"type": ["integer", "string"]},
            "run": {"type": ["integer", "string"]},
            "fingerprint": TEXT,
        },
    ),
}

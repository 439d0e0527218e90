"""Messages in JSON: boxes, detections and frames of Foxglove's schemas, tracks and scans of the bench's own.

Source: Foxglove schemas, ``foxglove.SceneUpdate``, ``foxglove.PointCloud`` and ``foxglove.FrameTransforms``.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from trackbench.base.errors import InputError, nearest_choices, shortened_text
from trackbench.base.types import Array
from trackbench.truth.tracks import COVARIANCE

T = TypeVar("T")
#: Names of schemas.
BOXES, TRANSFORMS, POINTS = "foxglove.SceneUpdate", "foxglove.FrameTransforms", "foxglove.PointCloud"
TRACKS, SCAN = "trackbench.Tracks", "trackbench.Scan"
#: Keys of a box's metadata.
VELOCITY = ("vx_mps", "vy_mps")
OF_RUN = ("scene", "run", "fingerprint")
#: ``foxglove.NumericType``, little-endian.
NUMERIC = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}

#: Of each frame that is a child: its parent, and the stamp in ns, x, y and yaw of each transform.
Moves = Mapping[str, list[tuple[str, int, float, float, float]]]


class Box(NamedTuple):
    """A cube of a scene."""

    id: str
    stamp: int
    """ns."""
    frame: str
    x: float
    y: float
    heading: float
    length: float
    width: float
    stated: dict[str, str]
    """Its metadata."""


def _parsed(messages: Sequence[Any], schema: str, parse: Callable[[Any], Iterator[T]], file: Path) -> Iterator[T]:
    for number, message in enumerate(messages):
        try:
            yield from parse(message)
        except (TypeError, KeyError, AttributeError, ValueError, OverflowError) as error:
            raise InputError(f"message {number + 1} of {schema} is damaged: {_why(error)}", file=file) from None


def columns_of_tracks(messages: Sequence[Any], file: Path) -> dict[str, Sequence[Any]]:
    """The tracks of ``trackbench.Tracks`` messages as columns, of which covariance, existence and run may be missing.

    Args:
        messages: decoded.
        file: for error messages.

    Raises:
        InputError: a message is damaged.
    """
    rows = list(_parsed(messages, TRACKS, _tracks_in, file))
    if not rows:
        raise InputError("there is no track in this file", file=file)
    return {name: [row.get(name) for row in rows] for name in dict.fromkeys(name for row in rows for name in row)}


def _tracks_in(message: Any) -> Iterator[dict[str, Any]]:
    common = {"time": _number(message["time_s"]), **{key: _plain(message[key]) for key in OF_RUN if key in message}}
    for track in _sequence(message["tracks"]):
        mean, covariance = [_number(value) for value in _sequence(track["mean"])], track.get("covariance")
        if len(mean) != 4:
            raise ValueError(f"a mean has {len(mean)} numbers, and not px, py, vx, vy")
        row = {**common, "id": _plain(track["id"]), **dict(zip(("x", "y", "vx", "vy"), mean, strict=True))}
        if track.get("existence") is not None:
            row["existence"] = track["existence"]
        if covariance is not None:
            if [len(_sequence(line)) for line in _sequence(covariance)] != [4] * 4:
                raise ValueError("a covariance is not 4 by 4: of px, py, vx, vy")
            row |= {name: covariance[a][b] for name, (a, b) in COVARIANCE.items()}
        yield row


def columns_of_boxes(messages: Sequence[Any], transforms: Sequence[Any], file: Path) -> dict[str, Sequence[Any]]:
    """The boxes of ``foxglove.SceneUpdate`` messages as columns, each at its own stamp and in the fixed frame.

    Args:
        messages: decoded.
        transforms: ``foxglove.FrameTransforms`` messages, decoded: a box in the frame of a moving child is moved.
        file: for error messages.

    Returns:
        time in s, id, x, y, heading, length, width, and each key of their metadata.

    Raises:
        InputError: a message is damaged, or boxes are in several frames between which nothing transforms.
    """
    boxes, place = _boxes_in_fixed_frame(messages, transforms, file)
    keys = dict.fromkeys(key for box in boxes for key in box.stated)
    return {
        **{key: [box.stated.get(key) for box in boxes] for key in keys},
        "time": [_seconds(box.stamp) for box in boxes],
        "id": [box.id for box in boxes],
        **dict(zip(("x", "y", "heading"), place.tolist(), strict=True)),
        "length": [box.length for box in boxes],
        "width": [box.width for box in boxes],
    }


def columns_of_frame(frame: str, transforms: Sequence[Any], file: Path) -> dict[str, Sequence[Any]]:
    """The pose of a frame in the fixed one as columns: time in s, x, y, yaw.

    Raises:
        InputError: a message is damaged, or nothing moves the frame.
    """
    moves = _moves(transforms, file)
    chain = [frame]
    while chain[-1] in moves and len(chain) < 100:
        chain.append(moves[chain[-1]][0][0])
    if len(chain) == 1:
        raise InputError(f"no transform has the child frame {frame!r}; {nearest_choices(frame, moves)}", file=file)
    # A mount is stated once, or rarely.
    stamps = sorted({move[1] for move in max((moves[child] for child in chain[:-1]), key=len)})
    place, _ = _in_fixed_frame(np.zeros((3, len(stamps))), stamps, [frame] * len(stamps), moves, file)
    return {"time": [*map(_seconds, stamps)], **dict(zip(("x", "y", "yaw"), place.tolist(), strict=True))}


def columns_of_detections(messages: Sequence[Any], schema: str, file: Path) -> dict[str, Sequence[Any]]:
    """Detections as columns: time in s, and what each has; a scan without one is a row with nothing else.

    Args:
        messages: decoded.
        schema: ``foxglove.PointCloud`` or ``trackbench.Scan``.
        file: for error messages.

    Raises:
        InputError: a message is damaged, or the points of two have other fields.
    """
    rows = list(_parsed(messages, schema, _points_in if schema == POINTS else _scans_in, file))
    names = dict.fromkeys(name for _, row in rows for name in row)
    return {**{name: [row.get(name) for _, row in rows] for name in names}, "time": [_seconds(at) for at, _ in rows]}


def _points_in(message: Any) -> Iterator[tuple[int, dict[str, Any]]]:
    stamp, pose, fields = _stamp(message["timestamp"]), message["pose"], _sequence(message["fields"])
    if any(pose["position"][key] for key in "xyz") or _yaw(pose["orientation"]):
        raise ValueError("its points have a pose of their own, which is not read: give them in the frame of the sensor")
    if unknown := [field["type"] for field in fields if field["type"] not in NUMERIC]:
        raise ValueError(f"{shortened_text(str(unknown[0]), 40)} is no foxglove.NumericType")
    names = [str(_plain(field["name"])) for field in fields]
    layout: Any = {
        "names": names,
        "formats": [NUMERIC[field["type"]] for field in fields],
        "offsets": [_whole(field["offset"]) for field in fields],
        "itemsize": _whole(message["point_stride"]),
    }
    points: Any = np.frombuffer(base64.b64decode(message["data"], validate=True), np.dtype(layout))
    rows = zip(*(points[name].tolist() for name in names), strict=True)
    yield from ((stamp, dict(zip(names, row, strict=True))) for row in rows)
    if not len(points):
        yield stamp, dict.fromkeys(names)


def _scans_in(message: Any) -> Iterator[tuple[int, dict[str, Any]]]:
    stamp, rows = _stamp(message["timestamp"]), _sequence(message["rows"])
    yield from ((stamp, dict(row)) for row in rows)
    if not rows:
        yield stamp, {}


def _boxes_in_fixed_frame(messages: Sequence[Any], transforms: Sequence[Any], file: Path) -> tuple[list[Box], Array]:
    """The boxes, and ``(3, boxes)`` x, y and heading of each in the fixed frame."""
    boxes = list(_parsed(messages, BOXES, _boxes_in, file))
    if not boxes:
        raise InputError("there is no box in this file: no entity has cubes", file=file)
    place = np.array([[box.x, box.y, box.heading] for box in boxes]).T
    frames, moves = [box.frame for box in boxes], _moves(transforms, file)
    place, moved = _in_fixed_frame(place, [box.stamp for box in boxes], frames, moves, file)
    if moved:
        # A velocity in a moving frame is not one over ground.
        boxes = [box._replace(stated={k: v for k, v in box.stated.items() if k not in VELOCITY}) for box in boxes]
    return boxes, place


def _boxes_in(message: Any) -> Iterator[Box]:
    for entity in _sequence(message["entities"]):
        cubes = _sequence(entity.get("cubes", []))
        if not cubes:
            continue
        if len(cubes) > 1:
            raise ValueError(f"entity {shortened_text(str(entity['id']), 40)} has {len(cubes)} cubes; a box has one")
        pose, size = cubes[0]["pose"], cubes[0]["size"]
        stated = {str(pair["key"]): str(pair["value"]) for pair in _sequence(entity.get("metadata", []))}
        for key in VELOCITY:
            float(stated.get(key, "nan"))
        yield Box(
            str(_plain(entity["id"])),
            _stamp(entity["timestamp"]),
            str(entity["frame_id"]),
            _number(pose["position"]["x"]),
            _number(pose["position"]["y"]),
            _yaw(pose["orientation"]),
            _number(size["x"]),
            _number(size["y"]),
            stated,
        )


def _moves(transforms: Sequence[Any], file: Path) -> Moves:
    moves: dict[str, list[tuple[str, int, float, float, float]]] = {}
    for child, move in _parsed(transforms, TRANSFORMS, _moves_in, file):
        moves.setdefault(child, []).append(move)
    return moves


def _moves_in(message: Any) -> Iterator[tuple[str, tuple[str, int, float, float, float]]]:
    for move in _sequence(message["transforms"]):
        parent, translation = str(move["parent_frame_id"]), move["translation"]
        place = _number(translation["x"]), _number(translation["y"]), _yaw(move["rotation"])
        yield str(move["child_frame_id"]), (parent, _stamp(move["timestamp"]), *place)


def _in_fixed_frame(
    place: Array, stamps: Sequence[int], frames: list[str], moves: Moves, file: Path
) -> tuple[Array, bool]:
    """``(3, rows)`` x, y, heading in the frame that is nobody's child, and whether rows had to be moved."""
    result, depth = place.copy(), 0
    time = np.array([(stamp - stamps[0]) / 1e9 for stamp in stamps])
    while any(frame in moves for frame in frames):
        depth += 1
        if depth > 100:
            raise InputError("the frames of its transforms are children of each other", file=file)
        for child in {*frames} & {*moves}:
            own = np.array([frame == child for frame in frames])
            parents = {parent for parent, *_ in moves[child]}
            if len(parents) > 1:
                raise InputError(f"the frame {child!r} has several parents: {first_names(parents)}", file=file)
            (parent,) = parents
            transforms = sorted(values for _, *values in moves[child])
            at = np.array([(stamp - stamps[0]) / 1e9 for stamp, *_ in transforms])
            x, y, yaw = np.array([pose for _, *pose in transforms]).T
            x, y, yaw = (np.interp(time[own], at, values) for values in (x, y, np.unwrap(yaw)))
            cos, sin = np.cos(yaw), np.sin(yaw)
            px, py, heading = result[:, own]
            result[:, own] = x + cos * px - sin * py, y + sin * px + cos * py, heading + yaw
            frames = [parent if frame == child else frame for frame in frames]
    if len({*frames}) > 1:
        problem = f"boxes are in several frames, and no transform says where one is: {first_names({*frames})}"
        raise InputError(problem, file=file)
    return result, depth > 0


def _stamp(value: Any) -> int:
    """ns."""
    return _whole(value["sec"]) * 10**9 + _whole(value["nsec"])


def _seconds(stamp: int) -> Decimal:
    return Decimal(stamp).scaleb(-9)


def first_names(names: Collection[str]) -> str:
    """The first of some names."""
    return ", ".join(shortened_text(name, 40) for name in sorted(names)[:5])


def _yaw(quaternion: Mapping[str, Any]) -> float:
    """Of a rotation about the vertical, rad."""
    x, y, z, w = (_number(quaternion[key]) for key in "xyzw")
    if not 0.99 < x * x + y * y + z * z + w * w < 1.01:
        raise ValueError("a rotation is no unit quaternion")
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise ValueError(f"{shortened_text(str(value), 40)} is not a finite number")
    return float(value)


def _whole(value: Any) -> int:
    # Some write the numbers of 64 bits as text, as the JSON of Protocol Buffers does.
    number = int(value) if isinstance(value, str) and value.isdecimal() and len(value) < 20 else value
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 10**15:
        raise ValueError(f"{shortened_text(str(value), 40)} is no whole number of seconds or nanoseconds")
    return number


def _plain(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise ValueError(f"{shortened_text(str(value), 40)} is no name")
    return value


def _sequence(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{shortened_text(str(value), 40)} is no list")
    return value


def _why(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"there is no {error}"
    return str(error) if isinstance(error, ValueError) else "its values are not of the types of the schema"

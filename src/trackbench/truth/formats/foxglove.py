"""Messages in JSON: boxes and frames of Foxglove's schemas, and tracks with covariances of the bench's own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, shortened
from trackbench.base.types import Array
from trackbench.truth.track_rows import TrackRows

#: Names of schemas.
BOXES, TRANSFORMS, POINTS = "foxglove.SceneUpdate", "foxglove.FrameTransforms", "foxglove.PointCloud"
TRACKS, SCAN = "trackbench.Tracks", "trackbench.Scan"
#: Times up to this count from 0 s, as a program's own clock does; larger ones from the first whole second.
FROM_ZERO_S = 10**7
#: Keys of a box's metadata.
VELOCITY = ("vx_mps", "vy_mps")
OF_RUN = ("scene", "run", "fingerprint")


class Box(NamedTuple):
    """A cube of a scene."""

    id: str
    stamp: tuple[int, int]
    """s, ns."""
    frame: str
    x: float
    y: float
    heading: float
    vx: float
    """NaN where it is not stated, as the next."""
    vy: float
    length: float
    width: float


def rows_of_tracks(messages: Sequence[Any], file: Path) -> TrackRows:
    """The rows of ``trackbench.Tracks`` messages.

    Args:
        messages: decoded.
        file: for error messages.

    Raises:
        InputError: a message is damaged.
    """
    ids: list[str] = []
    numbers: list[list[float]] = []
    covariances: list[Array] = []
    of_run: list[list[str]] = []
    for number, message in enumerate(messages):
        try:
            time = _number(message["time_s"])
            names = [str(_plain(message[key])) if key in message else "" for key in OF_RUN]
            for track in _sequence(message["tracks"]):
                mean = [_number(value) for value in _sequence(track["mean"])]
                if len(mean) != 4:
                    raise ValueError(f"a mean has {len(mean)} numbers, and not px, py, vx, vy")
                existence = track.get("existence")
                numbers.append([time, *mean, math.nan if existence is None else _probability(existence)])
                ids.append(str(_plain(track["id"])))
                covariances.append(_covariance(track.get("covariance")))
                of_run.append(names)
        except (TypeError, KeyError, AttributeError, ValueError) as error:
            raise InputError(f"message {number + 1} of {TRACKS} is damaged: {_why(error)}", file=file) from None
    if not ids:
        raise InputError("there is no track in this file", file=file)
    time, px, py, vx, vy, existence = np.array(numbers).T
    covariance = np.stack(covariances, axis=-1)
    stated = {key: list(column) for key, column in zip(OF_RUN, zip(*of_run, strict=True), strict=True) if any(column)}
    return TrackRows(
        ids,
        time,
        px,
        py,
        vx,
        vy,
        covariance=None if np.isnan(covariance).all() else covariance,
        existence=None if np.isnan(existence).all() else existence,
        scene=stated.get("scene"),
        run=stated.get("run"),
        fingerprint=stated.get("fingerprint"),
    )


def rows_of_boxes(messages: Sequence[Any], transforms: Sequence[Any], file: Path) -> TrackRows:
    """The rows of the boxes of ``foxglove.SceneUpdate`` messages, each at its own stamp and in the fixed frame.

    Args:
        messages: decoded.
        transforms: ``foxglove.FrameTransforms`` messages, decoded: a box in the frame of a moving child is moved.
        file: for error messages.

    Raises:
        InputError: a message is damaged, or boxes are in several frames between which nothing transforms.
    """
    boxes: list[Box] = []
    moves: dict[str, list[tuple[str, float, float, float, float]]] = {}
    for schema, every in ((BOXES, messages), (TRANSFORMS, transforms)):
        for number, message in enumerate(every):
            try:
                if schema == BOXES:
                    boxes += _boxes_in(message)
                else:
                    for move in _sequence(message["transforms"]):
                        moves.setdefault(str(move["child_frame_id"]), []).append(_moved(move))
            except (TypeError, KeyError, AttributeError, ValueError) as error:
                raise InputError(f"message {number + 1} of {schema} is damaged: {_why(error)}", file=file) from None
    if not boxes:
        raise InputError("there is no box in this file: no entity has cubes", file=file)
    first = min(box.stamp[0] for box in boxes)
    start = first if first > FROM_ZERO_S else 0
    time = np.array([box.stamp[0] - start + 1e-9 * box.stamp[1] for box in boxes])
    place = np.array([[box.x, box.y, box.heading] for box in boxes]).T
    frames = [box.frame for box in boxes]
    place, fixed = _in_fixed_frame(place, time + start, frames, moves, file)
    vx, vy, length, width = np.array([[box.vx, box.vy, box.length, box.width] for box in boxes]).T
    # A velocity in a moving frame is not one over ground.
    of_ground = fixed and bool(np.isfinite(vx).all() and np.isfinite(vy).all())
    return TrackRows(
        [box.id for box in boxes],
        time,
        place[0],
        place[1],
        vx=vx if of_ground else None,
        vy=vy if of_ground else None,
        heading=place[2],
        length=length,
        width=width,
        start=Decimal(start),
    )


def _boxes_in(message: Any) -> Iterator[Box]:
    for entity in _sequence(message["entities"]):
        cubes = _sequence(entity.get("cubes", []))
        if not cubes:
            continue
        if len(cubes) > 1:
            raise ValueError(f"entity {shortened(str(entity['id']), 40)} has {len(cubes)} cubes; a box has one")
        pose, size = cubes[0]["pose"], cubes[0]["size"]
        stated = {pair["key"]: pair["value"] for pair in _sequence(entity.get("metadata", []))}
        vx, vy = (float(stated.get(key, "nan")) for key in VELOCITY)
        position, stamp = pose["position"], entity["timestamp"]
        yield Box(
            str(_plain(entity["id"])),
            (_whole(stamp["sec"]), _whole(stamp["nsec"])),
            str(entity["frame_id"]),
            _number(position["x"]),
            _number(position["y"]),
            _yaw(pose["orientation"]),
            vx,
            vy,
            _number(size["x"]),
            _number(size["y"]),
        )


def _moved(move: Mapping[str, Any]) -> tuple[str, float, float, float, float]:
    """Parent frame, time in s, x, y and yaw of a transform."""
    stamp, translation = move["timestamp"], move["translation"]
    time = _whole(stamp["sec"]) + 1e-9 * _whole(stamp["nsec"])
    return (
        str(move["parent_frame_id"]),
        time,
        _number(translation["x"]),
        _number(translation["y"]),
        _yaw(move["rotation"]),
    )


def _in_fixed_frame(
    place: Array,
    time: Array,
    frames: list[str],
    moves: Mapping[str, list[tuple[str, float, float, float, float]]],
    file: Path,
) -> tuple[Array, bool]:
    """``(3, rows)`` x, y, heading in the frame that is nobody's child, and whether no row had to be moved."""
    moved, depth = place.copy(), 0
    while any(frame in moves for frame in frames):
        depth += 1
        if depth > 100:
            raise InputError("the frames of its transforms are children of each other", file=file)
        for child in {*frames} & {*moves}:
            own = np.array([frame == child for frame in frames])
            parents = {parent for parent, *_ in moves[child]}
            if len(parents) > 1:
                raise InputError(f"the frame {child!r} has several parents: {_named(parents)}", file=file)
            at, x, y, yaw = np.array(sorted(values for _, *values in moves[child])).T
            x, y, yaw = (np.interp(time[own], at, values) for values in (x, y, np.unwrap(yaw)))
            cos, sin = np.cos(yaw), np.sin(yaw)
            px, py, heading = moved[:, own]
            moved[:, own] = x + cos * px - sin * py, y + sin * px + cos * py, heading + yaw
            frames = [parents.copy().pop() if frame == child else frame for frame in frames]
    if len({*frames}) > 1:
        problem = f"boxes are in several frames, and no transform says where one is: {_named({*frames})}"
        raise InputError(problem, file=file)
    return moved, depth == 0


def _named(names: set[str]) -> str:
    return ", ".join(shortened(name, 40) for name in sorted(names)[:5])


def _yaw(quaternion: Mapping[str, Any]) -> float:
    """Of a rotation about the vertical, rad."""
    x, y, z, w = (_number(quaternion[key]) for key in "xyzw")
    if not 0.99 < x * x + y * y + z * z + w * w < 1.01:
        raise ValueError("a rotation is no unit quaternion")
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _covariance(value: Any) -> Array:
    """``(4, 4)``; NaN where none is stated."""
    if value is None:
        return np.full((4, 4), np.nan)
    rows = [[math.nan if entry is None else _number(entry) for entry in _sequence(row)] for row in _sequence(value)]
    if [len(row) for row in rows] != [4] * 4:
        raise ValueError("a covariance is not 4 by 4: of px, py, vx, vy")
    return np.array(rows)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise ValueError(f"{shortened(str(value), 40)} is not a finite number")
    return float(value)


def _probability(value: Any) -> float:
    if not 0 <= _number(value) <= 1:
        raise ValueError(f"existence is {value:g}, which is no probability")
    return float(value)


def _whole(value: Any) -> int:
    # Some write the numbers of 64 bits as text, as the JSON of Protocol Buffers does.
    number = int(value) if isinstance(value, str) and value.isdecimal() and len(value) < 20 else value
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 10**15:
        raise ValueError(f"{shortened(str(value), 40)} is no whole number of seconds or nanoseconds")
    return number


def _plain(value: Any) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise ValueError(f"{shortened(str(value), 40)} is no name")
    return value


def _sequence(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{shortened(str(value), 40)} is no list")
    return value


def _why(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"there is no {error}"
    return str(error) if isinstance(error, ValueError) else "its values are not of the types of the schema"

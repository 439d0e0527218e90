"""Traces of the ASAM Open Simulation Interface (OSI), whose messages are also found in MCAP.

A trace needs only four messages with twenty fields, so they are decoded here in 40 lines. ``betterosi`` and
``protobuf`` would bring generated code for all of OSI, and ``protobuf`` restricts the versions of other packages.

Sources: ASAM OSI 3.7, ``osi_sensorview.proto``, ``osi_groundtruth.proto``, ``osi_object.proto``, ``osi_common.proto``;
Protocol Buffers documentation, "Encoding".
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from trackbench.base.errors import InputError, counted
from trackbench.base.files import read_bytes
from trackbench.truth.tracks import TrackRows, TrafficFormat

#: Field numbers of messages.
GROUND_TRUTH_OF_VIEW = 7
TIMESTAMP, MOVING_OBJECT = 2, 5
OBJECT_ID, OBJECT_BASE, OBJECT_TYPE, CLASSIFICATION = 1, 2, 3, 6
DIMENSION, POSITION, ORIENTATION, VELOCITY = 1, 2, 3, 4
#: Classes by ``osi3.MovingObject.Type`` and by ``VehicleClassification.Type``.
OBJECTS = {3: "pedestrian", 4: "animal"}
VEHICLES = {2: "car", 3: "car", 4: "car", 5: "car", 6: "van", 7: "truck", 8: "trailer", 9: "trailer"}
VEHICLES |= {10: "motorcycle", 11: "bicycle", 12: "bus", 13: "tram", 14: "train"}

Kind = Literal["SensorView", "GroundTruth"]
KINDS: tuple[Kind, ...] = get_args(Kind)


class OsiTrace(TrafficFormat):
    """ASAM OSI trace (.osi): moving objects of GroundTruth if the file's name has _gt_, else of SensorView."""

    endings: ClassVar[tuple[str, ...]] = (".osi",)

    def rows(self, file: Path) -> TrackRows:
        kind: Kind = "GroundTruth" if "_gt_" in file.name else "SensorView"
        content = memoryview(read_bytes(file))
        return moving_objects(file, kind, _delimited(content, file))


def moving_objects(file: Path, kind: Kind, messages: Iterable[memoryview]) -> TrackRows:
    """Return the rows of the moving objects in messages, in the frame fixed to the ground.

    Args:
        file: file, for error messages.
        kind: type of the messages.
        messages: encoded messages.

    Raises:
        InputError: a message is damaged, or there is no moving object.
    """
    rows: list[tuple[float, ...]] = []
    ids: list[str] = []
    kinds: list[str] = []
    try:
        for message in messages:
            for ground_truth in _parts(message, GROUND_TRUTH_OF_VIEW) if kind == "SensorView" else (message,):
                for name, row, of_class in _objects(ground_truth):
                    ids.append(name)
                    rows.append(row)
                    kinds.append(of_class)
    except (ValueError, IndexError, struct.error, OverflowError) as error:
        raise InputError(f"a message after {counted(len(rows), 'row')} is damaged: {error}", file=file) from None
    if not rows:
        raise InputError("there is no moving object in this file", file=file)
    time, px, py, heading, vx, vy, length, width = np.array(rows).T
    velocity = {"vx": vx, "vy": vy} if np.isfinite(vx).all() and np.isfinite(vy).all() else {}
    return TrackRows(ids, time, px, py, **velocity, heading=heading, length=length, width=width, kind=kinds)


def _delimited(content: memoryview, file: Path) -> Iterator[memoryview]:
    """Yield the messages of a file; each is preceded by its length in four bytes, little-endian."""
    offset = 0
    while offset < len(content):
        size = int.from_bytes(content[offset : offset + 4], "little")
        if offset + 4 + size > len(content):
            raise InputError(f"the message at byte {offset} is longer than the rest of the file", file=file)
        yield content[offset + 4 : offset + 4 + size]
        offset += 4 + size


def _objects(ground_truth: memoryview) -> Iterator[tuple[str, tuple[float, ...], str]]:
    """Yield name, row (time, x, y, heading, vx, vy, length, width) and class; a missing velocity is NaN, a size 0."""
    stamp = dict(_fields(_part(ground_truth, TIMESTAMP)))
    time = int(stamp.get(1, 0)) + 1e-9 * int(stamp.get(2, 0))
    for item in _parts(ground_truth, MOVING_OBJECT):
        base = _part(item, OBJECT_BASE)
        x, y = _vector(_part(base, POSITION), 1, 2)
        (yaw,) = _vector(_part(base, ORIENTATION), 3)
        velocity = _vector(_part(base, VELOCITY), 1, 2) if any(_parts(base, VELOCITY)) else (np.nan, np.nan)
        length, width = _vector(_part(base, DIMENSION), 1, 2)
        of_object = int(dict(_fields(item)).get(OBJECT_TYPE, 0))
        of_vehicle = int(dict(_fields(_part(item, CLASSIFICATION))).get(1, 0))
        kind = OBJECTS.get(of_object) or VEHICLES.get(of_vehicle, "")
        name = str(dict(_fields(_part(item, OBJECT_ID))).get(1, 0))
        yield name, (time, x, y, yaw, *velocity, length, width), kind


def _vector(message: memoryview, *numbers: int) -> tuple[float, ...]:
    """Return the values of the double fields with these numbers; 0 for a missing field."""
    fields = dict(_fields(message))
    if not all(isinstance(fields.get(number, 0.0), float) for number in numbers):
        raise ValueError("a field that is not of its type")
    return tuple(fields.get(number, 0.0) for number in numbers)


def _part(message: memoryview, number: int) -> memoryview:
    """Return the last message in the field of this number, as Protocol Buffers demand; empty if there is none."""
    parts = [*_parts(message, number)]
    return parts[-1] if parts else memoryview(b"")


def _parts(message: memoryview, number: int) -> Iterator[memoryview]:
    for key, value in _fields(message):
        if key == number:
            if not isinstance(value, memoryview):
                raise ValueError("a field that is not of its type")
            yield value


def _fields(message: memoryview) -> Iterator[tuple[int, Any]]:
    """Yield number and value of each field: an int, a float, or the bytes of a text or message."""
    offset = 0
    while offset < len(message):
        value: Any
        key, offset = _varint(message, offset)
        wire = key & 7
        if wire == 0:
            value, offset = _varint(message, offset)
        elif wire in (1, 5):
            size, code = (8, "<d") if wire == 1 else (4, "<f")
            (value,), offset = struct.unpack(code, message[offset : offset + size]), offset + size
        elif wire == 2:
            size, offset = _varint(message, offset)
            if offset + size > len(message):
                raise ValueError("a field is longer than its message")
            value, offset = message[offset : offset + size], offset + size
        else:
            raise ValueError(f"wire type {wire} is not used")
        yield key >> 3, value


def _varint(message: memoryview, offset: int) -> tuple[int, int]:
    """Return the integer that starts at ``offset``, stored in seven bits a byte, and the offset of its end."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[offset]
        offset += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, offset
    raise ValueError("an integer of more than ten bytes")

"""Traces of the ASAM Open Simulation Interface, whose messages are also found in MCAP.

A trace needs four messages with twenty fields. They are read from the wire, in 40 lines: ``betterosi`` and ``protobuf``
bring generated code of all of OSI, and the latter pins the versions of others.

Sources: ASAM OSI 3.7, ``osi_sensorview.proto``, ``osi_groundtruth.proto``, ``osi_object.proto``, ``osi_common.proto``;
Protocol Buffers documentation, "Encoding".
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field

from trackbench.base.errors import InputError, counted
from trackbench.base.files import read_bytes
from trackbench.truth.tracks import TrackRows, TrafficFormat

#: Numbers of fields.
GROUND_TRUTH_OF_VIEW = 7
TIMESTAMP, MOVING_OBJECT = 2, 5
OBJECT_ID, OBJECT_BASE, OBJECT_TYPE, CLASSIFICATION = 1, 2, 3, 6
DIMENSION, POSITION, ORIENTATION, VELOCITY = 1, 2, 3, 4
#: Of ``osi3.MovingObject.Type`` and of ``VehicleClassification.Type``.
OBJECTS = {3: "pedestrian", 4: "animal"}
VEHICLES = {2: "car", 3: "car", 4: "car", 5: "car", 6: "van", 7: "truck", 8: "trailer", 9: "trailer"}
VEHICLES |= {10: "motorcycle", 11: "bicycle", 12: "bus", 13: "tram", 14: "train"}

Kind = Literal["SensorView", "GroundTruth"]
KINDS: tuple[Kind, ...] = get_args(Kind)


class OsiTrace(TrafficFormat):
    """ASAM OSI trace, binary (.osi): the moving objects of SensorView or GroundTruth messages."""

    endings: ClassVar[tuple[str, ...]] = (".osi",)
    message: Kind | None = Field(
        None, description="The type of the messages; GroundTruth where the file's name has _gt_, else SensorView."
    )

    def rows(self, file: Path) -> TrackRows:
        kind = self.message or ("GroundTruth" if "_gt_" in file.name else "SensorView")
        content = memoryview(read_bytes(file))
        return moving_objects(file, kind, _delimited(content, file))


def moving_objects(file: Path, kind: Kind, messages: Iterable[memoryview]) -> TrackRows:
    """The rows of the moving objects of messages, in the frame that is fixed to the ground. OSI has no covariance.

    Args:
        file: for error messages.
        kind: of the messages.
        messages: as they are on the wire.

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
    """Messages, each after its length as four bytes, little-endian."""
    at = 0
    while at < len(content):
        size = int.from_bytes(content[at : at + 4], "little")
        if at + 4 + size > len(content):
            raise InputError(f"the message at byte {at} is longer than the rest of the file", file=file)
        yield content[at + 4 : at + 4 + size]
        at += 4 + size


def _objects(ground_truth: memoryview) -> Iterator[tuple[str, tuple[float, ...], str]]:
    """Name, row (time, x, y, heading, vx, vy, length, width) and class of each moving object; NaN where a velocity is
    missing, 0 where a size is."""
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
    """Fields of type double, 0 where they are left out."""
    fields = dict(_fields(message))
    if not all(isinstance(fields.get(number, 0.0), float) for number in numbers):
        raise ValueError("a field that is not of its type")
    return tuple(fields.get(number, 0.0) for number in numbers)


def _part(message: memoryview, number: int) -> memoryview:
    """The last message in a field, as the format has it; empty where there is none."""
    parts = [*_parts(message, number)]
    return parts[-1] if parts else memoryview(b"")


def _parts(message: memoryview, number: int) -> Iterator[memoryview]:
    """The messages in a repeated field."""
    for key, value in _fields(message):
        if key == number:
            if not isinstance(value, memoryview):
                raise ValueError("a field that is not of its type")
            yield value


def _fields(message: memoryview) -> Iterator[tuple[int, Any]]:
    """Number and value of each field: an int, a float, or the bytes of a text or message."""
    at = 0
    while at < len(message):
        value: Any
        key, at = _varint(message, at)
        wire = key & 7
        if wire == 0:
            value, at = _varint(message, at)
        elif wire in (1, 5):
            size, code = (8, "<d") if wire == 1 else (4, "<f")
            (value,), at = struct.unpack(code, message[at : at + size]), at + size
        elif wire == 2:
            size, at = _varint(message, at)
            if at + size > len(message):
                raise ValueError("a field is longer than its message")
            value, at = message[at : at + size], at + size
        else:
            raise ValueError(f"wire type {wire} is not used")
        yield key >> 3, value


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """An integer of seven bits a byte, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise ValueError("an integer of more than ten bytes")

"""The framing between the bench and a program in another language, version 1 (docs/any-language.md).

A frame is its length, uint32 little-endian, and a MessagePack map. An array is [shape, bytes], the bytes those of
float64, little-endian, the last axis running fastest.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import msgpack
import numpy as np

from trackbench.base.types import Array, Estimate, Scan, Tracks
from trackbench.trackers.answers import ASYMMETRY

VERSION = 1
LENGTH = struct.Struct("<I")
#: Bytes of a frame. The length of a longer one would be that of printed text: a byte of text is 9 or more.
LARGEST = 1 << 27
FLOAT = np.dtype("<f8")
_SIXTEEN = struct.Struct("<16d")
_FOUR = struct.Struct("<4d")
#: The entries above the diagonal of a covariance, and those that mirror them.
_MIRRORED = ((1, 4), (2, 8), (3, 12), (6, 9), (7, 13), (11, 14))
_OPTIONAL = ("innovation", "innovation_covariance", "mode_probabilities", "repaired")
_packer = msgpack.Packer()
_pack = _packer.pack
_YES, _NO = (FLOAT.type(value).tobytes() for value in (1.0, 0.0))


class NotAFrame(Exception):
    """Bytes that are no answer; says why."""


def packed_array(value: Any) -> list[Any]:
    """An array as a message has it."""
    array = np.asarray(value, dtype=FLOAT)
    return [array.shape, array.tobytes()]


def framed(message: Mapping[str, Any]) -> bytes:
    """A message as a frame.

    Raises:
        TypeError, ValueError, OverflowError: it has a value that MessagePack does not know.
    """
    content: bytes = _pack(message)
    return LENGTH.pack(len(content)) + content


class ScanFrames:
    """The frames of one scan for several trackers; what they share is packed once."""

    def __init__(self, scan: Scan) -> None:
        shared = {
            "type": "scan",
            "time": float(scan.time),
            "arrival_time": float(scan.arrival_time),
            "sensor": scan.sensor,
            "kind": scan.kind,
            "noise_covariance": packed_array(scan.noise_covariance),
            "sensor_pose": packed_array(scan.sensor_pose),
            "sensor_velocity": packed_array(scan.sensor_velocity),
            "asked": scan.asked,
            "place": int(scan.place),
        }
        if scan.field_of_view is not None:
            view = scan.field_of_view
            shared["field_of_view"] = packed_array(
                [view.half_angle, view.max_range, math.nan if view.volume is None else view.volume]
            )
        for name in ("detection_probability", "clutter_density"):
            if (value := getattr(scan, name)) is not None:
                shared[name] = float(value)
        head: bytes = _packer.pack_map_header(len(shared) + 3)
        self._shared = head + b"".join(_pack(name) + _pack(value) for name, value in shared.items())

    def of(self, number: int, measurement: Array, valid: Any) -> bytes:
        """The frame for a tracker.

        Args:
            number: of the tracker.
            measurement: ``(m, ...)``.
            valid: ``(...)``.
        """
        content = self._shared + _entry("measurement", measurement.shape) + measurement.tobytes()
        content += _entry("valid", valid.shape) + valid.astype(FLOAT).tobytes() + b"\xa2id" + _pack(number)
        frame: bytes = LENGTH.pack(len(content)) + content
        return frame

    def of_each(self, numbers: Sequence[int], measurements: Array, valid: Sequence[bool]) -> list[bytes]:
        """The frames for trackers of one object each: measurements ``(n, m)``, valid ``(n,)``."""
        size = measurements.shape[1]
        before = self._shared + _entry("measurement", (size,))
        between = _entry("valid", ())
        content, width = measurements.astype(FLOAT).tobytes(), size * FLOAT.itemsize
        frames = []
        for place, number in enumerate(numbers):
            own = content[place * width : (place + 1) * width]
            frame = b"".join((before, own, between, _YES if valid[place] else _NO, b"\xa2id", _pack(number)))
            frames.append(LENGTH.pack(len(frame)) + frame)
        return frames


@lru_cache(maxsize=1024)
def _entry(name: str, shape: tuple[int, ...]) -> bytes:
    """The bytes of an array in a map up to those of its numbers."""
    size = math.prod(shape) * FLOAT.itemsize
    array: bytes = _pack(name) + b"\x92" + _pack(shape) + _pack(bytes(size))
    return array[: len(array) - size]


def unpacked(content: bytes | memoryview) -> dict[str, Any]:
    """The message of a frame.

    Raises:
        NotAFrame: it is no MessagePack map.
    """
    try:
        message = msgpack.unpackb(content)
    except Exception as error:
        raise NotAFrame(f"no MessagePack ({type(error).__name__})") from error
    if type(message) is not dict:
        raise NotAFrame(f"no MessagePack map, but {type(message).__name__}")
    return message


def array_of(message: Mapping[str, Any], name: str) -> Array:
    """An array of a message.

    Raises:
        NotAFrame: there is none, or it is not of the right form.
    """
    value = message.get(name)
    if value is None:
        raise NotAFrame(f"{message.get('type')!r} without {name}")
    if not isinstance(value, list) or len(value) != 2 or not isinstance(value[1], bytes):
        raise NotAFrame(f"{name} is not [shape, bytes]")
    shape, content = value
    if not isinstance(shape, list) or not all(type(length) is int and length >= 0 for length in shape):
        raise NotAFrame(f"the shape of {name} is not a list of numbers from 0")
    if len(shape) > 4 or math.prod(shape) * FLOAT.itemsize != len(content):
        raise NotAFrame(f"{name} has {len(content)} bytes, where float64 of the shape {shape} have another number")
    return np.frombuffer(bytearray(content), dtype=FLOAT).reshape(shape)


def estimate_of(message: Mapping[str, Any]) -> Estimate:
    """The estimate of a message; of what is not told there is None.

    Raises:
        NotAFrame: an array is not of the right form.
    """
    parts: dict[str, Any] = {name: array_of(message, name) for name in ("mean", "covariance")}
    parts |= {name: array_of(message, name) for name in _OPTIONAL if message.get(name) is not None}
    if "repaired" in parts:
        parts["repaired"] = parts["repaired"] != 0
    return Estimate(**parts)


def tracks_of(message: Mapping[str, Any]) -> Tracks:
    """The tracks of a message.

    Raises:
        NotAFrame: an array is not of the right form.
    """
    parts: dict[str, Any] = {name: array_of(message, name) for name in ("ids", "mean", "covariance")}
    parts |= {name: array_of(message, name) for name in ("existence", "used") if message.get(name) is not None}
    for name in {"ids", "used"} & set(parts):
        if np.all(np.abs(parts[name]) < 1 << 53) and np.all(parts[name] == np.floor(parts[name])):
            parts[name] = parts[name].astype(np.intp)
    return Tracks(**parts)


def plain_estimate(message: Mapping[str, Any], one: list[int], square: list[int]) -> tuple[bytes, bytes] | None:
    """The numbers of one mean and covariance that need no further check; None where they do, or there is more.

    The checks of arrays take ten times as long for so few numbers.

    Args:
        message: an answer.
        one: the shape of the mean, of 4 numbers.
        square: the shape of the covariance, of 16.
    """
    if len(message) != 4 or message["type"] != "estimate":
        return None
    try:
        (shape, mean), (square_shape, covariance) = message["mean"], message["covariance"]
        if shape != one or square_shape != square:
            return None
        values = _SIXTEEN.unpack(covariance)
        if not math.isfinite(sum(values) + sum(_FOUR.unpack(mean))):
            return None
    except (KeyError, TypeError, ValueError, struct.error):
        return None
    tolerance = ASYMMETRY * max(values)
    symmetric = all(abs(values[i] - values[j]) <= tolerance for i, j in _MIRRORED)
    return (mean, covariance) if symmetric else None

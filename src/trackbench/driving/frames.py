"""The framing between the bench and the process of a tracker, version 1 (docs/any-language.md).

A frame is its length, uint32 little-endian, and a MessagePack map. An array is [shape, bytes], the bytes those of
float64, little-endian, the last axis running fastest.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import msgpack
import numpy as np

from trackbench.base.types import Array, Estimate, FieldOfView, Scan, Tracks
from trackbench.trackers.answers import ASYMMETRY, TrackerFault

VERSION = 1
LENGTH = struct.Struct("<I")
#: Bytes of a frame. The length of a longer one would be that of printed text: a byte of text is 9 or more.
LARGEST = 1 << 27
#: Bytes that are read at once: for more, each read gets its memory from the system, which takes 20 us.
READ = 1 << 16
FLOAT = np.dtype("<f8")
ANY_TEXT = "surrogatepass"
_OPTIONAL = ("innovation", "innovation_covariance", "mode_probabilities", "repaired", "state")


class NotAFrame(Exception):
    """Bytes that are no answer; says why."""


def packed_array(value: Any) -> list[Any]:
    """An array as a message has it."""
    array = np.asarray(value, dtype=FLOAT)
    return [list(array.shape), array.tobytes()]


def _packable(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return packed_array(value)
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{str(value)[:40]} ({type(value).__name__}) is no value of MessagePack")


#: Half a character may be in the name of a file, or in an error of a tracker.
_packer = msgpack.Packer(default=_packable, unicode_errors=ANY_TEXT)
_pack = _packer.pack


def message_frame(message: Mapping[str, Any]) -> bytes:
    """A message as a frame.

    Raises:
        TypeError, ValueError, OverflowError: it has a value that MessagePack does not know.
    """
    return _framed(_pack(message))


class ScanFrames:
    """The frames of one scan for several trackers; what they share is packed once."""

    def __init__(self, scan: Scan) -> None:
        shared = {
            "type": "scan",
            "time": float(scan.time),
            "arrival_time": float(scan.arrival_time),
            "sensor": scan.sensor,
            "kind": scan.kind,
            "asked": scan.asked,
            "place": int(scan.place),
        }
        arrays = {name: getattr(scan, name) for name in ("noise_covariance", "sensor_pose", "sensor_velocity")}
        if scan.field_of_view is not None:
            view = scan.field_of_view
            volume = math.nan if view.volume is None else view.volume
            arrays["field_of_view"] = np.array([view.half_angle, view.max_range, volume])
        for name in ("detection_probability", "clutter_density", "half_range_m"):
            if (value := getattr(scan, name)) is not None:
                shared[name] = float(value)
        # With the arrays of one tracker and its number.
        self._shared = _entries(shared, arrays, len(shared) + len(arrays) + 3)

    def of(self, whom: bytes, given: Scan) -> bytes:
        """The frame for the tracker that ``id_of`` names, with the measurement that is given."""
        return _framed(
            *self._shared,
            *_array_entry("measurement", given.measurement),
            *_array_entry("valid", given.valid),
            whom,
        )


def id_of(number: int) -> bytes:
    """The entry of a map that names one tracker."""
    entry: bytes = b"\xa2id" + _pack(number)
    return entry


def _entries(values: Mapping[str, Any], arrays: Mapping[str, Any], size: int) -> list[bytes]:
    """The start of a map of so many entries, with values and arrays: fewer than 16 values, so that their own head is a
    byte."""
    parts = [_packer.pack_map_header(size), _pack(values)[1:]]
    for name, array in arrays.items():
        parts += _array_entry(name, array)
    return parts


def _array_entry(name: str, value: Any) -> tuple[bytes, bytes]:
    """An entry of a map up to the numbers of an array, and the numbers."""
    array = np.asarray(value, dtype=FLOAT)
    return _head(name, array.shape), array.tobytes()


@lru_cache(maxsize=1024)
def _head(name: str, shape: tuple[int, ...]) -> bytes:
    size = math.prod(shape) * FLOAT.itemsize
    array: bytes = _pack(name) + b"\x92" + _pack(shape) + _pack(bytes(size))
    return array[: len(array) - size]


def _framed(*content: bytes) -> bytes:
    return b"".join((LENGTH.pack(sum(map(len, content))), *content))


def frame_message(content: bytes | bytearray | memoryview) -> dict[str, Any]:
    """The message of a frame.

    Raises:
        NotAFrame: it is no MessagePack map.
    """
    try:
        message = msgpack.unpackb(content, strict_map_key=False, unicode_errors=ANY_TEXT)
    except Exception as error:
        raise NotAFrame(f"no MessagePack ({type(error).__name__})") from error
    if type(message) is not dict:
        raise NotAFrame(f"no MessagePack map, but {type(message).__name__}")
    return message


def read_message(read: Callable[[int], bytes]) -> dict[str, Any]:
    """Return the next message.

    Args:
        read: gives at most so many bytes, and none at the end.

    Raises:
        EOFError: the other side has ended.
        NotAFrame: the bytes received are none.
    """
    (size,) = LENGTH.unpack(_exactly(LENGTH.size, read))
    if size > LARGEST:
        raise NotAFrame(f"{size} bytes long")
    return frame_message(_exactly(size, read))


def _exactly(size: int, read: Callable[[int], bytes]) -> bytes:
    content = read(size)
    while len(content) < size:
        more = read(size - len(content))
        if not more:
            raise EOFError
        content += more
    return content


def message_scan(message: Mapping[str, Any]) -> Scan:
    """Return the scan of a message; its arrays are read-only."""
    parts = {name: message[name] for name in Scan._fields if name in message}
    for name in ("measurement", "valid", "noise_covariance", "sensor_pose", "sensor_velocity"):
        parts[name] = _read_only_array(*parts[name])
    parts["valid"] = parts["valid"] != 0
    if isinstance(parts["valid"], np.ndarray):
        parts["valid"].setflags(write=False)
    if "field_of_view" in parts:
        half_angle, max_range, volume = _read_only_array(*parts["field_of_view"]).tolist()
        parts["field_of_view"] = FieldOfView(half_angle, max_range, None if math.isnan(volume) else volume)
    return Scan(**parts)


def _read_only_array(shape: Sequence[int], content: bytes) -> Any:
    # The empty index makes a number of an array without axes.
    return np.ndarray(shape, FLOAT, content)[()]


def answer_frame(number: int, answer: Estimate | Tracks | None) -> bytes:
    """Return the frame of a tracker's answer to a scan."""
    if answer is None:
        return message_frame({"type": "none", "id": number})
    arrays = {name: value for name, value in zip(answer._fields, answer, strict=True) if value is not None}
    if "state" in arrays and not _is_numeric(arrays["state"]):
        # A state of another form is the tracker's own affair.
        del arrays["state"]
    values = {"type": "tracks" if isinstance(answer, Tracks) else "estimate", "id": number}
    return _framed(*_entries(values, arrays, len(values) + len(arrays)))


def _is_numeric(value: Any) -> bool:
    try:
        np.asarray(value, dtype=FLOAT)
    except (TypeError, ValueError):
        return False
    return True


def message_array(message: Mapping[str, Any], name: str) -> Array:
    """An array of a message.

    Raises:
        TrackerFault: there is none, or it is not of the right form.
    """
    match message.get(name):
        case [[*shape], bytes(content)] if all(type(length) is int and length >= 0 for length in shape[:5]):
            if len(shape) <= 4 and math.prod(shape) * FLOAT.itemsize == len(content):
                return np.frombuffer(bytearray(content), dtype=FLOAT).reshape(shape)
            problem = f"{name} has {len(content)} bytes, where float64 of the shape {shape[:5]} have another number"
        case None:
            problem = f"{message.get('type')!r} without {name}"
        case _:
            problem = f"{name} is not [shape, bytes], the shape a list of numbers from 0"
    raise TrackerFault(f"its answer is wrong: {problem}")


def message_estimate(message: Mapping[str, Any]) -> Estimate:
    """The estimate of a message; of what is not told there is None.

    Raises:
        TrackerFault: an array is not of the right form.
    """
    parts: dict[str, Any] = {name: message_array(message, name) for name in ("mean", "covariance")}
    parts |= {name: message_array(message, name) for name in _OPTIONAL if message.get(name) is not None}
    if "repaired" in parts:
        parts["repaired"] = parts["repaired"] != 0
    return Estimate(**parts)


def tracks_of(message: Mapping[str, Any]) -> Tracks:
    """The tracks of a message.

    Raises:
        TrackerFault: an array is not of the right form.
    """
    parts: dict[str, Any] = {name: message_array(message, name) for name in ("ids", "mean", "covariance")}
    parts |= {name: message_array(message, name) for name in ("existence", "used") if message.get(name) is not None}
    return Tracks(**parts)


def plain_estimate(messages: Sequence[Mapping[str, Any]], *batch: int) -> Estimate | None:
    """The estimate ``(4, n)`` of answers that need no closer look: all are right, and say no more than an estimate.

    Args:
        messages: for one member each; or one message.
        batch: members of the one message.
    """
    means, covariances, size = [], [], 4 * FLOAT.itemsize * math.prod(batch)
    try:
        for message in messages:
            (shape, mean), (square, covariance) = message["mean"], message["covariance"]
            if len(message) != 4 or shape != [4, *batch] or square != [4, 4, *batch]:
                return None
            if len(mean) != size or len(covariance) != 4 * size or message["type"] != "estimate":
                return None
            means.append(mean)
            covariances.append(covariance)
        if batch:
            flat = np.ndarray((4, *batch), FLOAT, *means)
            square = np.ndarray((4, 4, *batch), FLOAT, *covariances)
        else:
            flat = np.ndarray((len(means), 4), FLOAT, b"".join(means)).T.copy()
            square = np.ndarray((len(means), 4, 4), FLOAT, b"".join(covariances)).transpose(1, 2, 0).copy()
    except (KeyError, TypeError, ValueError):
        return None
    if not math.isfinite(np.add.reduce(flat, axis=None) + np.add.reduce(square, axis=None)):
        return None
    mirrored = square.swapaxes(0, 1)
    # Bytes are compared in less time than numbers.
    if mirrored.tobytes() != square.tobytes():
        gap = np.abs(square - mirrored).max()
        return Estimate(flat, square) if gap <= ASYMMETRY * square.max(axis=(0, 1)).min() else None
    return Estimate(flat, square)

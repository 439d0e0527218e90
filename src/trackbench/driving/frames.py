"""Frames of the messages between the bench and the process of a tracker, version 1 (docs/any-language.md).

A frame is its length (uint32, little-endian) and a MessagePack map. An array is [shape, bytes], with the bytes in
float64, little-endian, last axis fastest.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgpack
import numpy as np

from trackbench.base.types import Array, Estimate, FieldOfView, Scan, Tracks
from trackbench.trackers.answers import OF_ONE, OF_SEVERAL, TrackerFault

VERSION = 1
LENGTH = struct.Struct("<I")
#: Largest number of bytes of a frame. Printed text read as a length gives more, since its bytes are 9 or larger.
LARGEST = 1 << 27
FLOAT = np.dtype("<f8")
#: Arrays of a scan in a message: one tracker's own, and shared by all trackers.
OWN_ARRAYS, SHARED_ARRAYS = ("measurement", "valid"), ("noise_covariance", "sensor_pose", "sensor_velocity")
#: Arrays of an answer; the arrays after the covariance are optional.
ARRAYS = {
    "estimate": (
        "mean",
        "covariance",
        "innovation",
        "innovation_covariance",
        "mode_probabilities",
        "repaired",
        "state",
    ),
    "tracks": ("ids", "mean", "covariance", "existence", "used"),
}


class NotAFrame(Exception):
    """Error for bytes from a tracker's process that are no message; its text says why."""


def packed_array(value: Any) -> list[Any]:
    """Return an array as the pair [shape, bytes] that a message contains."""
    array = np.asarray(value, FLOAT)
    return [array.shape, array.tobytes()]


def _packable(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return packed_array(value)
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{str(value)[:40]} ({type(value).__name__}) is no value of MessagePack")


# Errors and names of files may have characters that are not whole.
_pack = msgpack.Packer(default=_packable, unicode_errors="replace").pack


def message_frame(message: Mapping[str, Any]) -> bytes:
    """Return a message packed as the bytes of a frame: length, then MessagePack map.

    Raises:
        TypeError, ValueError, OverflowError: MessagePack cannot store a value of the message.
    """
    content: bytes = _pack(message)
    return LENGTH.pack(len(content)) + content


def frame_message(content: bytes | bytearray | memoryview) -> dict[str, Any]:
    """Return the message unpacked from a frame's MessagePack map.

    Raises:
        NotAFrame: the content is no MessagePack map.
    """
    try:
        message = msgpack.unpackb(content, strict_map_key=False, unicode_errors="replace")
    except Exception as error:
        raise NotAFrame(f"no MessagePack ({type(error).__name__})") from error
    if type(message) is not dict:
        raise NotAFrame(f"no MessagePack map, but {type(message).__name__}")
    return message


def read_message(read: Callable[[int], bytes]) -> dict[str, Any]:
    """Read the next message from a stream of frames.

    Args:
        read: returns the given number of bytes, fewer only at the end of the stream.

    Raises:
        EOFError: the other side has ended.
    """
    head = read(LENGTH.size)
    content = read(*LENGTH.unpack(head)) if len(head) == LENGTH.size else b""
    if not content:
        raise EOFError
    return frame_message(content)


def scan_frames(numbers: Sequence[int], scans: Sequence[Scan]) -> list[bytes]:
    """Return one frame for each tracker, which delivers its scan; all scans are of one sensor and time.

    Args:
        numbers: protocol numbers of the trackers.
        scans: one scan for each tracker; their shared entries are packed once.
    """
    frames, pose, shared = [], None, b""
    for number, scan in zip(numbers, scans, strict=True):
        if scan.sensor_pose is not pose:
            pose, shared = scan.sensor_pose, _shared_entries(scan)
        own_entries = {"id": number, "measurement": packed_array(scan.measurement), "valid": packed_array(scan.valid)}
        # The first byte of a map of at most 15 entries is their number, which the shared start already states.
        content = shared + _pack(own_entries)[1:]
        frames.append(LENGTH.pack(len(content)) + content)
    return frames


def _shared_entries(scan: Scan) -> bytes:
    named = zip(Scan._fields, scan, strict=True)
    entries: dict[str, Any] = {name: value for name, value in named if value is not None and name not in OWN_ARRAYS}
    entries["type"] = "scan"
    for name in SHARED_ARRAYS:
        entries[name] = packed_array(entries[name])
    if (view := scan.field_of_view) is not None:
        volume = math.nan if view.volume is None else view.volume
        entries["field_of_view"] = packed_array([view.half_angle, view.max_range, volume])
    header: bytes = msgpack.Packer().pack_map_header(len(entries) + len(OWN_ARRAYS) + 1)
    shared: bytes = header + _pack(entries)[1:]
    return shared


def message_scan(message: Mapping[str, Any]) -> Scan:
    """Return the scan that a message contains, with read-only arrays."""
    parts: dict[str, Any] = dict(message)
    del parts["type"], parts["id"]
    for name in (*OWN_ARRAYS, *SHARED_ARRAYS):
        shape, content = parts[name]
        # The empty index turns an array without axes into a number.
        parts[name] = np.ndarray(shape, FLOAT, content)[()]
    valid = parts["valid"] = parts["valid"] != 0
    if isinstance(valid, np.ndarray):
        valid.setflags(write=False)
    if "field_of_view" in parts:
        half_angle, max_range, volume = np.ndarray(3, FLOAT, parts["field_of_view"][1]).tolist()
        parts["field_of_view"] = FieldOfView(half_angle, max_range, None if math.isnan(volume) else volume)
    return Scan(**parts)


def is_plain(answer: Any) -> bool:
    """Return whether a tracker's answer is only a mean and a covariance, both float64 arrays of any shape."""
    if not isinstance(answer, tuple) or len(answer) < 2 or any(part is not None for part in answer[2:]):
        return False
    mean, covariance = answer[:2]
    return type(mean) is type(covariance) is np.ndarray and mean.dtype == covariance.dtype == FLOAT


def answer_frame(number: int, answer: Any) -> bytes:
    """Return the frame of a tracker's answer to a scan; ``number`` is the tracker's protocol number."""
    if answer is None:
        return message_frame({"type": "none", "id": number})
    kind = "tracks" if isinstance(answer, Tracks) else "estimate"
    if is_plain(answer):
        mean, covariance = answer[:2]
        arrays = {"mean": packed_array(mean), "covariance": packed_array(covariance)}
    else:
        named = ((name, getattr(answer, name)) for name in ARRAYS[kind])
        # Only a numeric state goes into the message.
        arrays = {
            name: packed_array(value)
            for name, value in named
            if value is not None and (name != "state" or _is_numeric(value))
        }
    return message_frame({"type": kind, "id": number, **arrays})


def _is_numeric(value: Any) -> bool:
    return np.asarray(value).dtype.kind in "fiub"


def message_answer(message: Mapping[str, Any], several: bool) -> Estimate | tuple[Array, Array] | Tracks | None:
    """Return the tracker's answer that a message contains; its arrays are read-only and their shapes unchecked.

    Args:
        message: of the type ``estimate``, ``tracks`` or, for the answer None, ``none``.
        several: whether the tracker follows several objects.

    Raises:
        TrackerFault: the answer is of another sort than ``several`` says, or an array does not follow the protocol.
    """
    kind = message["type"]
    if kind == "none":
        return None
    if (kind == "tracks") != several:
        raise TrackerFault(OF_ONE if several else OF_SEVERAL)
    if len(message) == 4:
        return _array(message, "mean"), _array(message, "covariance")
    required = 3 if several else 2
    names = [name for place, name in enumerate(ARRAYS[kind]) if place < required or message.get(name) is not None]
    parts = {name: _array(message, name) for name in names}
    if several:
        return Tracks(**parts)
    if "repaired" in parts:
        parts["repaired"] = parts["repaired"] != 0
    return Estimate(**parts)


def _array(message: Mapping[str, Any], name: str) -> Any:
    try:
        shape, content = message[name]
        if math.prod(shape) * FLOAT.itemsize == len(content):
            return np.ndarray(shape, FLOAT, content)
        problem = f"{name} has {len(content)} bytes, where float64 of the shape {shape[:5]} have another number"
    except KeyError:
        problem = f"{message['type']!r} without {name}"
    except (TypeError, ValueError, OverflowError):
        problem = f"{name} is not [shape, bytes], the shape a list of numbers from 0"
    raise TrackerFault(f"its answer is wrong: {problem}")

"""Messages between the bench and the process of a tracker.

Requests are pickled. Answers are not: they come from code that nobody here knows, and are JSON and plain arrays.
"""

from __future__ import annotations

import json
import pickle
import socket
import struct
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

#: Report of the template: whether it is of a start, the process, and how that ended (as of ``os.waitpid``).
REPORT = struct.Struct("<?ii")
#: Set in the environment of every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
_LENGTH = struct.Struct("<Q")
#: Of the JSON part of an answer, bytes.
LARGEST_HEADER = 1 << 20
#: Of an answer's arrays together, bytes.
LARGEST_ARRAYS = 1 << 32
_TYPES = {"d": np.dtype(np.float64), "?": np.dtype(np.bool_), "l": np.dtype(np.int64)}

Arrays = Mapping[str, npt.NDArray[Any]]


class Malformed(Exception):
    """The bytes received are no valid answer."""


def send_request(to: socket.socket, request: Mapping[str, Any]) -> None:
    """Pickle and send."""
    content = pickle.dumps(request, protocol=pickle.HIGHEST_PROTOCOL)
    to.sendall(_LENGTH.pack(len(content)))
    to.sendall(content)


class Source(Protocol):
    """Where bytes come from: a socket."""

    def recv_into(self, buffer: memoryview) -> int: ...


def receive_request(source: Source) -> dict[str, Any]:
    """The next request.

    Raises:
        EOFError: the other side has ended.
    """
    result: dict[str, Any] = pickle.loads(_receive(source, _LENGTH.unpack(_receive(source, _LENGTH.size))[0]))
    return result


def send_answer(to: socket.socket, values: Mapping[str, Any], arrays: Arrays) -> None:
    """Send JSON values, and arrays of float, bool or int."""
    described = [[name, array.dtype.char, array.shape] for name, array in arrays.items()]
    header = json.dumps({"values": values, "arrays": described}).encode()
    parts = [np.ascontiguousarray(array).data.cast("B") for array in arrays.values() if array.size]
    to.sendall(_LENGTH.pack(len(header)) + header)
    for part in parts:
        to.sendall(part)


def receive_answer(source: Source) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """The next answer: its values and its arrays.

    Raises:
        EOFError: the other side has ended.
        Malformed: the bytes received are no valid answer.
    """
    (size,) = _LENGTH.unpack(_receive(source, _LENGTH.size))
    if size > LARGEST_HEADER:
        raise Malformed
    try:
        header = json.loads(_receive(source, size))
        values, described = header["values"], header["arrays"]
        shapes = [(str(name), _TYPES[kind], tuple(map(int, shape))) for name, kind, shape in described]
        sizes = [_size(shape) * kind.itemsize for _, kind, shape in shapes]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise Malformed from error
    if not isinstance(values, dict) or sum(sizes) > LARGEST_ARRAYS:
        raise Malformed
    result = {}
    for (name, kind, shape), number in zip(shapes, sizes, strict=True):
        result[name] = np.frombuffer(_receive(source, number), dtype=kind).reshape(shape)
    return values, result


def _size(shape: tuple[int, ...]) -> int:
    size = 1
    for length in shape:
        if length < 0:
            raise ValueError(length)
        size *= length
    return size


def _receive(source: Source, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    done = 0
    while done < size:
        number = source.recv_into(view[done:])
        if number == 0:
            raise EOFError
        done += number
    return content

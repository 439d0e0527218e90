"""Messages between the bench and the process of a tracker.

Requests are pickled. Answers are not: they come from code that nobody here knows, and are JSON and plain arrays.
"""

from __future__ import annotations

import json
import pickle
import socket
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

#: Set in the environment of every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
_LENGTH = struct.Struct("<Q")
#: Of the JSON part of an answer, bytes.
LARGEST_HEADER = 1 << 20
#: Of an answer's arrays together, bytes.
LARGEST_ARRAYS = 1 << 32
_TYPES = {"d": np.dtype(np.float64), "?": np.dtype(np.bool_), "l": np.dtype(np.int64)}

Arrays = Mapping[str, npt.NDArray[Any]]


class ProcessReport(NamedTuple):
    """What the bench is told of the process that guards a tracker's."""

    started: bool
    """Whether it was started; else it has ended."""
    process: int
    """Its number."""
    status: int = 0
    """How the tracker's process ended, as of ``os.waitpid``."""
    memory: int = 0
    """What the tracker took when it was ended for that, bytes; else 0."""
    unshown: int = 0
    """Lines that it printed and that were not shown."""
    lines: int = 0
    """How many more would have been shown."""
    last: bytes = b""
    """The end of what a program printed."""

    def packed(self) -> bytes:
        """As bytes, of which there are always as many."""
        return _REPORT.pack(*self)

    @classmethod
    def unpacked(cls, content: bytes) -> ProcessReport:
        """From bytes.

        Raises:
            EOFError: they are not all there.
        """
        if len(content) < _REPORT.size:
            raise EOFError
        *numbers, last = _REPORT.unpack(content)
        return cls(*numbers)._replace(last=last.rstrip(b"\0"))


#: Bytes of a launch, and of the end of what a program printed.
LONGEST_LAUNCH, LAST = 1 << 16, 400
_REPORT = struct.Struct(f"<?iiQQQ{LAST}s")
REPORT_SIZE = _REPORT.size


class Launch(NamedTuple):
    """The process of a tracker that is to be started: what it may take and print, and the program if it is one."""

    name: str
    """What its output is said to be of."""
    memory: int = 0
    """Bytes."""
    lines: int = 0
    """Shown ones."""
    command: list[str] | None = None
    """A program and its arguments; None of a tracker in Python."""
    folder: str = "."
    """Where a program is started."""
    python_path: str | None = None
    """``PYTHONPATH`` as a program finds it."""

    def packed(self) -> bytes:
        """As bytes, at most ``LONGEST_LAUNCH``."""
        return json.dumps(self._replace(name=self.name[:500])).encode()

    @classmethod
    def unpacked(cls, content: bytes) -> Launch:
        """From bytes."""
        return cls(*json.loads(content))


class Malformed(Exception):
    """The bytes received are no valid answer."""


def send_request(to: socket.socket, request: Mapping[str, Any]) -> None:
    """Pickle and send."""
    content = pickle.dumps(request, protocol=pickle.HIGHEST_PROTOCOL)
    to.sendall(_LENGTH.pack(len(content)) + content)


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
    # At once, since each part wakes the other side.
    to.sendall(b"".join((_LENGTH.pack(len(header)), header, *(array.tobytes() for array in arrays.values()))))


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

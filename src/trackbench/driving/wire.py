"""Messages between the bench and the process of a tracker in Python: frames as of programs in other languages.

Nothing in them is pickled but classes of a notebook, which the bench sends, and what `work` returns.
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import msgpack
import numpy as np
import numpy.typing as npt

from trackbench.driving.frames import LARGEST, LENGTH

#: Set in the environment of every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
#: The extension of MessagePack that is an array: its type, shape and bytes.
ARRAY = 1
#: Half a character may be in the name of a file, or in an error of a tracker.
ANY_TEXT = "surrogatepass"
_TYPES = {"d": np.dtype(np.float64), "?": np.dtype(np.bool_), "l": np.dtype(np.int64)}

Arrays = Mapping[str, npt.NDArray[Any]]


#: What the bench is told of a process: whether it was started, or has ended; its number; its status as of
#: ``os.waitpid``.
REPORT = struct.Struct("<?ii")
#: Bytes of a launch.
LONGEST_LAUNCH = 1 << 16


class Launch(NamedTuple):
    """The process of a tracker that is to be started."""

    name: str
    """Name of the tracker in messages."""
    command: list[str] | None = None
    """A program and its arguments; None of a tracker in Python."""
    folder: str = "."
    """Where a program is started."""
    python_path: str | None = None
    """``PYTHONPATH`` as a program finds it."""

    def packed(self) -> bytes:
        """Return it as bytes, at most ``LONGEST_LAUNCH``."""
        return json.dumps(self._replace(name=self.name[:500])).encode()

    @classmethod
    def unpacked(cls, content: bytes) -> Launch:
        """Read it from bytes."""
        return cls(*json.loads(content))


class Malformed(Exception):
    """The bytes received are no valid answer."""


def exchange_frame(message: Mapping[str, Any]) -> bytes:
    """A message as a frame, in which values may be arrays.

    Raises:
        TypeError, ValueError, OverflowError: it has a value that MessagePack does not know.
    """
    content: bytes = msgpack.packb(message, default=_array_frame, unicode_errors=ANY_TEXT)
    return LENGTH.pack(len(content)) + content


def send_answer(to: socket.socket, values: Mapping[str, Any], arrays: Arrays) -> None:
    """Send values, and arrays of float, bool or int."""
    to.sendall(exchange_frame({"values": values, "arrays": arrays}))


class Source(Protocol):
    """Where bytes come from: a socket."""

    def recv_into(self, buffer: memoryview) -> int: ...


def receive_message(source: Source) -> dict[str, Any]:
    """The next message.

    Raises:
        EOFError: the other side has ended.
        Malformed: the bytes received are none.
    """
    (size,) = LENGTH.unpack(_received(source, LENGTH.size))
    if size > LARGEST:
        raise Malformed
    content = _received(source, size)
    try:
        message = msgpack.unpackb(content, ext_hook=_array, strict_map_key=False, unicode_errors=ANY_TEXT)
    except Exception as error:
        raise Malformed from error
    if not isinstance(message, dict):
        raise Malformed
    return message


def _array_frame(value: Any) -> Any:
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError(f"{str(value)[:40]} ({type(value).__name__}) is no value of MessagePack")
    kind = value.dtype.char if value.dtype.char in _TYPES else "d"
    return msgpack.ExtType(ARRAY, msgpack.packb([kind, value.shape, value.astype(_TYPES[kind]).tobytes()]))


def _array(_: int, content: bytes) -> Any:
    kind, shape, numbers = msgpack.unpackb(content)
    if any(length < 0 for length in shape):
        raise ValueError(shape)
    # Of bytes, so that a tracker cannot write into a scan; the empty index makes a number of an array without axes.
    return np.frombuffer(numbers, dtype=_TYPES[kind]).reshape(shape)[()]


def _received(source: Source, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    done = 0
    while done < size:
        number = source.recv_into(view[done:])
        if number == 0:
            raise EOFError
        done += number
    return content

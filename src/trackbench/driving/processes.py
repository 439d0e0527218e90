"""The process that starts those of trackers, as the bench speaks to it."""

from __future__ import annotations

import atexit
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import BinaryIO, NamedTuple
from uuid import uuid4

from trackbench.base.errors import TrackbenchError
from trackbench.driving.descendants import end_marked

#: Set in the environment of every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
FORK_SERVER = "trackbench.driving.fork_server"
#: The start of the command of a tracker in Python.
HOST = [sys.executable, "-m", "trackbench.driving.host"]
#: What the bench is told of a process: its number, and, once it has ended, its status as of ``os.waitpid``.
NUMBER = struct.Struct("<i")
NOT_STARTED = "no process can be started for a tracker"
#: How long the end of all that was started may take, s.
ENDING = 10.0
#: Variables of the environment that a tracker is not told.
UNTOLD = ("TRACKBENCH_DATA", "PYTEST_CURRENT_TEST")


class Launch(NamedTuple):
    """The process of a tracker that is to be started: the first message that it reads."""

    command: list[str]
    """Program and arguments."""
    folder: str
    """Its working directory."""
    python_path: str | None
    """Its ``PYTHONPATH``; None where it has none."""


class ForkServer:
    """The process that starts those of trackers, as the bench speaks to it."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair()
        self._mark = f"{INSIDE}={uuid4()}"
        output = 2 if _is_open(2) else subprocess.DEVNULL
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", FORK_SERVER, str(theirs.fileno())],
                env=_environment() | dict([self._mark.split("=")]),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=[theirs.fileno()],
                # Ctrl-C is for the bench, which ends the trackers.
                start_new_session=True,
            )

    @property
    def ended(self) -> bool:
        """Whether it was killed."""
        return self._process.poll() is not None

    def start(self, descriptors: Sequence[int]) -> None:
        """Start the process of a tracker.

        Args:
            descriptors: for reports, standard input and standard output of the process.

        Raises:
            TrackbenchError: it cannot be started.
        """
        try:
            socket.send_fds(self._control, [b"+"], [*descriptors, *_outputs[-1:]])
        except OSError as error:
            raise TrackbenchError(NOT_STARTED) from error

    def close(self) -> None:
        """End it, with all that its processes have left behind."""
        self._control.close()
        try:
            self._process.wait(ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.returncode < 0:
            # It was killed: what its processes have left behind is known by the mark in the environment.
            end_marked(self._mark)


def _environment() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in UNTOLD}
    return kept | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


_fork_servers: dict[int, ForkServer] = {}
#: Descriptors of the files to which what trackers print goes, in place of standard error: that of the last one.
_outputs: list[int] = []


def fork_server() -> ForkServer:
    """Return that of this process, which may itself be a copy of one that has one."""
    own = os.getpid()
    if own not in _fork_servers or _fork_servers[own].ended:
        _fork_servers[own] = ForkServer()
        atexit.register(_fork_servers[own].close)
    return _fork_servers[own]


@contextmanager
def printing_to(file: BinaryIO) -> Iterator[None]:
    """Send what trackers print whose processes are started meanwhile to a file."""
    _outputs.append(file.fileno())
    try:
        yield
    finally:
        _outputs.pop()

"""Process of a tracker: its start, its answers to frames over pipes, its limits, and its end as a group."""

from __future__ import annotations

import atexit
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.reduction import send_handle
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

from trackbench.base import notebook_classes
from trackbench.base.errors import TrackbenchError
from trackbench.base.exit_status import how_it_ended
from trackbench.base.types import Progress
from trackbench.base.user_code import place_in_dump
from trackbench.driving.faults import Kind, TrackFault, reported_error
from trackbench.driving.frames import LARGEST, LENGTH, NotAFrame, frame_message, message_frame
from trackbench.driving.isolation import GIGABYTE, Isolation

#: Environment variable that marks every tracker's process.
INSIDE = "TRACKBENCH_TRACKER_PROCESS"
#: Start of the command of a tracker in Python.
HOST = [sys.executable, "-m", "trackbench.driving.host"]
#: Report on a tracker's process: its id and, once it has ended, its status as in ``os.waitpid``.
NUMBER = struct.Struct("<i")
NOT_STARTED = "no process can be started for a tracker"
#: Period at which the bench checks the time and memory of a process that it waits for, s.
GLANCE = 0.1
#: Longest time for writing the stack of an aborted process, and for an end, s.
DUMPING, ENDING = 1.0, 10.0
#: Bytes read at once. A larger read allocates its memory from the system, which takes 20 us.
READ = 1 << 16
#: First bytes of a MessagePack map, and characters shown of an answer that is no frame.
MAPS, SHOWN = frozenset([*range(0x80, 0x90), 0xDE, 0xDF]), 60
#: Start of each call in the output of Python's faulthandler, and the most bytes of this output that are read.
DUMPED, LONGEST_DUMP = b'  File "', 1 << 20


class ForkServer:
    """Client of the server process that forks the processes of trackers."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._control, theirs = Pipe()
        serve = f"from trackbench.driving.fork_server import serve; serve({theirs.fileno()})"
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path}; {serve}"],
                stdin=subprocess.DEVNULL,
                # Trackers inherit Python's standard output, and print to standard error.
                stdout=2,
                pass_fds=[theirs.fileno()],
                # Ctrl-C is for the bench, which ends the trackers.
                start_new_session=True,
            )
        atexit.register(self._close)

    def start(self, command: list[str], folder: str, descriptors: Sequence[int]) -> None:
        """Start the process of a tracker.

        Args:
            command: program and arguments.
            folder: working directory.
            descriptors: file descriptors for the process's reports, standard input, standard output and standard error.

        Raises:
            OSError: the server has ended.
        """
        environment = {**os.environ, INSIDE: "1"}
        with self._lock:
            self._control.send({"command": command, "folder": folder, "path": sys.path, "environment": environment})
            for descriptor in descriptors:
                send_handle(self._control, descriptor, self.process.pid)

    def _close(self) -> None:
        self._control.close()
        # A fork of this process may keep the server alive.
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(ENDING)


_fork_servers: dict[int, ForkServer] = {}
#: Descriptors of files for what trackers print; the last one is in use.
_outputs = [2]


def fork_server() -> ForkServer:
    """Return the client of this process's fork server; start the server if there is none."""
    server = _fork_servers.get(os.getpid())
    if server is None or server.process.poll() is not None:
        server = _fork_servers[os.getpid()] = ForkServer()
    return server


@contextmanager
def printing_to(file: BinaryIO) -> Iterator[None]:
    """Send to a file what trackers print, for tracker processes started inside the context."""
    _outputs.append(file.fileno())
    try:
        yield
    finally:
        _outputs.pop()


class TrackerProcess:
    """Process that runs one or several trackers; it answers the frames (packed messages) sent to it.

    Args:
        isolation: limits of time and memory.
        command: program and arguments.
        folder: working directory.
        name: prefix of messages about the process.

    Raises:
        TrackbenchError: no process can be started.
    """

    def __init__(self, isolation: Isolation, command: list[str], folder: str, name: str = "") -> None:
        self.timeout, self._most, self._name = isolation.timeout, isolation.bytes, name
        self.fault: TrackFault | None = None
        """Fault that ended the process; None while it runs."""
        self.members = 0
        """Number of batch members that the trackers in the process follow."""
        self._taken, self._until, self._next_glance = 0, 0.0, 0.0
        self._status: int | None = None
        self._unsent, self._received = b"", bytearray()
        reading, self._out = os.pipe()
        self._in, writing = os.pipe()
        self._reports, reporting = os.pipe()
        try:
            fork_server().start(command, folder, (reporting, reading, writing, _outputs[-1]))
        except OSError as error:
            raise TrackbenchError(NOT_STARTED) from error
        finally:
            _close(reading, writing, reporting)
        number = os.read(self._reports, NUMBER.size)
        if not number:
            raise TrackbenchError(NOT_STARTED)
        (self._number,) = NUMBER.unpack(number)
        self._end = weakref.finalize(self, _end, self._number, self._reports, self._in, self._out)
        os.set_blocking(self._out, False)
        self._readable, self._writable = _poll(self._in, select.POLLIN), _poll(self._out, select.POLLOUT)

    def close(self) -> None:
        """End the process and all that it has started."""
        if self.fault is None:
            self.failed("its process was closed", "died")

    def send(self, *frames: bytes) -> None:
        """Send frames (packed messages) to the process; a call of ``receive`` then returns each answer.

        Raises:
            TrackFault: the process has ended, or does not read.
        """
        if self.fault is not None:
            raise self.fault
        content, self._unsent = memoryview(b"".join((self._unsent, *frames))), b""
        self._until = time.monotonic() + self.timeout
        while content:
            try:
                content = content[os.write(self._out, content) :]
            except BlockingIOError:
                self._wait(self._writable)
            except OSError:
                raise self._ended() from None

    def receive(self) -> dict[str, Any]:
        """Return the next answer of the process, as a message.

        Raises:
            TrackFault: the tracker failed; its process has ended, is late, or wrote no valid answer.
            InputError: the tracker cannot be found or does not take its options.
        """
        self._until = time.monotonic() + self.timeout
        self._read(LENGTH.size + 1)
        (size,) = LENGTH.unpack_from(self._received)
        if not 0 < size <= LARGEST or self._received[LENGTH.size] not in MAPS:
            raise self._no_frame()
        end = LENGTH.size + size
        self._read(end)
        content = self._received[LENGTH.size : end]
        del self._received[:end]
        try:
            answer = frame_message(content)
        except NotAFrame as error:
            raise self.failed(f"its answer is {error}; it begins with {_shown_bytes(content)}") from None
        if answer.get("type") == "error":
            raise reported_error(answer, self.members, self._name)
        return answer

    def work(self, function: str, arguments: Mapping[str, Any], progress: Progress) -> Any:
        """Call a function of trackbench in a Python tracker's process; return its result.

        Args:
            function: ``module:name``; it must report progress, or end, within the time limit of an answer.
            arguments: arguments of the function, texts and numbers only.
            progress: called with each progress report.

        Raises:
            TrackFault: the process has ended, is late, or wrote no valid answer.
            InputError: the tracker cannot be found or does not take its options.
        """
        classes = notebook_classes.dumps(None)
        self.send(message_frame({"type": "work", "function": function, "arguments": arguments, "classes": classes}))
        while (answer := self.receive()).get("type") == "progress":
            progress(answer["done"], answer["expected"])
        return pickle.loads(answer["pickled"])

    def failed(self, cause: str, kind: Kind = "answer", place: str | None = None) -> TrackFault:
        """End the process if it still runs; return the fault with a cause, for the caller to raise."""
        self._end()
        self.fault = TrackFault(f"{self._name}{cause}", kind, place)
        return self.fault

    def _read(self, byte_count: int) -> None:
        while len(self._received) < byte_count:
            self._wait(self._readable)
            content = os.read(self._in, READ)
            if not content:
                raise self._ended()
            self._received += content

    def _wait(self, poll: select.poll) -> None:
        """Wait until a pipe of the process is ready; raise a fault if it is late, ended, or takes too much memory."""
        is_ready = False
        while not is_ready:
            is_ready = bool(poll.poll(1000 * GLANCE))
            now = time.monotonic()
            if now < self._next_glance:
                continue
            self._next_glance = now + GLANCE
            self._taken = _resident_memory(self._number)
            if self._taken > self._most or (not is_ready and self._ended_within(0.0)):
                raise self._ended()
            if now >= self._until:
                raise self._late()

    def _late(self) -> TrackFault:
        # Makes Python's faulthandler write the stack.
        with suppress(ProcessLookupError):
            os.kill(self._number, signal.SIGABRT)
        self._ended_within(DUMPING)
        cause = f"it gave no answer within {self.timeout:g} s (see --tracker-timeout)"
        return self.failed(cause, "died", self._place())

    def _ended(self) -> TrackFault:
        cause = "its process closed the connection"
        if self._taken > self._most:
            taken, most = self._taken / GIGABYTE, self._most / GIGABYTE
            cause = f"it took {taken:.3g} GB of memory, more than the {most:.3g} GB allowed (see --tracker-memory)"
        elif self._ended_within(min(ENDING, self.timeout)) and self._status is not None:
            cause = how_it_ended(os.waitstatus_to_exitcode(self._status))
        return self.failed(cause, "died", self._place())

    def _no_frame(self) -> TrackFault:
        # Waits for the rest of the output, which may be a stack.
        self._place(GLANCE)
        if DUMPED in self._received and self._ended_within(DUMPING):
            return self._ended()
        hint = "what a program prints belongs on standard error"
        return self.failed(f"its output is no message: it begins with {_shown_bytes(self._received)}; {hint}")

    def _place(self, patience: float = 0.0) -> str | None:
        """Return the innermost line of the tracker's code in the stack that Python dumped; None without one.

        Output is read for ``patience`` s first.
        """
        while len(self._received) < LONGEST_DUMP and self._readable.poll(1000 * patience):
            content = os.read(self._in, READ)
            if not content:
                break
            self._received += content
        return place_in_dump(self._received.decode(errors="replace"))

    def _ended_within(self, seconds: float) -> bool:
        if self._status is None and _poll(self._reports, select.POLLIN).poll(1000 * seconds):
            content = os.read(self._reports, NUMBER.size)
            # A tracker that kills its group kills the process that reports, too.
            self._status = NUMBER.unpack(content)[0] if content else int(signal.SIGKILL)
        return self._status is not None


def _poll(descriptor: int, event: int) -> select.poll:
    poll = select.poll()
    poll.register(descriptor, event)
    return poll


def _shown_bytes(content: bytes | bytearray) -> str:
    return repr(bytes(content[:SHOWN])).removeprefix("b")


def _end(process: int, reports: int, *pipes: int) -> None:
    # Without a reader of its reports a tracker is ended, too; but a fork of this process may have the pipe as well.
    if not _poll(reports, select.POLLIN).poll(0):
        with suppress(ProcessLookupError):
            os.killpg(os.getpgid(process), signal.SIGKILL)
    _close(reports, *pipes)


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def _resident_memory(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0

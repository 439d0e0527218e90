"""Process of a tracker: its start, its answers to frames over pipes, its limits, and its end as a group."""

from __future__ import annotations

import atexit
import os
import pickle
import select
import signal
import socket
import struct
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO
from uuid import uuid4

from trackbench.base import notebook_classes
from trackbench.base.errors import TrackbenchError
from trackbench.base.exit_status import how_it_ended
from trackbench.base.types import Progress
from trackbench.base.user_code import place_in_dump
from trackbench.driving.descendants import descendants, end_marked, memory_of
from trackbench.driving.faults import Kind, TrackFault, reported_error
from trackbench.driving.frames import LARGEST, LENGTH, NotAFrame, frame_message, message_frame
from trackbench.driving.isolation import GIGABYTE, Isolation

#: Environment variable that marks every tracker's process, and variables withheld from trackers.
INSIDE, HIDDEN = "TRACKBENCH_TRACKER_PROCESS", ("TRACKBENCH_DATA", "PYTEST_CURRENT_TEST")
#: Start of the command of a tracker in Python.
HOST = [sys.executable, "-m", "trackbench.driving.host"]
#: Report of the fork server on a process: its id and, once it has ended, its status as in ``os.waitpid``.
NUMBER = struct.Struct("<i")
NOT_STARTED = "no process can be started for a tracker"
#: Period at which the bench checks the time and memory of a process that it waits for, s.
GLANCE = 0.1
#: Longest time for writing the stack of an aborted process, for a start and for an end, s.
DUMPING, STARTING, ENDING = 1.0, 60.0, 10.0
#: Bytes read at once. A larger read allocates its memory from the system, which takes 20 us.
READ = 1 << 16
#: First bytes of a MessagePack map, and characters shown of an answer that is no frame.
MAPS, SHOWN = frozenset([*range(0x80, 0x90), 0xDE, 0xDF]), 60
#: Start of each call in the output of Python's faulthandler, and the most bytes of this output that are read.
DUMPED, LONGEST_DUMP = b'  File "', 1 << 20


class ForkServer:
    """Client of the server process that forks the processes of trackers."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair()
        self._mark = f"{INSIDE}={uuid4()}"
        serve = f"from trackbench.driving.fork_server import serve; serve({theirs.fileno()})"
        output = 2 if os.path.exists("/dev/fd/2") else subprocess.DEVNULL
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path}; {serve}"],
                env=self._environment(),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
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
            descriptors: file descriptors for the process's reports, standard input and standard output.

        Raises:
            TrackbenchError: the server does not accept the request.
        """
        launch = {"command": command, "folder": folder, "path": sys.path, "environment": self._environment()}
        try:
            socket.send_fds(self._control, [message_frame(launch)], [*descriptors, *_outputs[-1:]])
        except OSError as error:
            raise TrackbenchError(NOT_STARTED) from error

    def _environment(self) -> dict[str, str]:
        return {name: value for name, value in os.environ.items() if name not in HIDDEN} | dict([self._mark.split("=")])

    def _close(self) -> None:
        self._control.close()
        try:
            self.process.wait(ENDING)
        except subprocess.TimeoutExpired:
            self.process.kill()
        if self.process.wait() < 0:
            # A killed server leaves processes behind, which the mark in their environment identifies.
            end_marked(self._mark)


_fork_servers: dict[int, ForkServer] = {}
#: Descriptors of files for the output of trackers; the last one replaces standard error.
_outputs: list[int] = []


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
    """Process of trackers, which answers the frames sent to it.

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
            fork_server().start(command, folder, (reporting, reading, writing))
        finally:
            for descriptor in (reading, writing, reporting):
                os.close(descriptor)
        number = self._reported(STARTING)
        if number is None:
            raise TrackbenchError(NOT_STARTED)
        os.set_blocking(self._out, False)
        self._number = number
        self._end = weakref.finalize(self, _end, number, self._reports, (self._out, self._in))
        self._readable, self._writable = _poll(self._in, select.POLLIN), _poll(self._out, select.POLLOUT)

    def close(self) -> None:
        """End the process and all that it has started."""
        if self.fault is None:
            self.failed("its process was closed", "died")

    def send(self, *frames: bytes) -> None:
        """Send frames to the process; each answer is then received by ``receive``.

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
            self._taken = memory_of([self._number, *descendants(self._number)], self._most)
            if self._taken > self._most or (not is_ready and self._ended_within(0.0)):
                raise self._ended()
            if now >= self._until:
                raise self._late()

    def _late(self) -> TrackFault:
        # Makes Python's faulthandler write the stack.
        with suppress(ProcessLookupError, PermissionError):
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
        """Return the last line of the tracker's code in Python's dump, after reading output for ``patience`` s."""
        while len(self._received) < LONGEST_DUMP and self._readable.poll(1000 * patience):
            content = os.read(self._in, READ)
            if not content:
                break
            self._received += content
        return place_in_dump(self._received.decode(errors="replace"))

    def _ended_within(self, seconds: float) -> bool:
        if self._status is None:
            self._status = self._reported(seconds)
        return self._status is not None

    def _reported(self, seconds: float) -> int | None:
        """Return the fork server's next report, an id or exit status; SIGKILL if the server has ended."""
        if not _poll(self._reports, select.POLLIN).poll(1000 * seconds):
            return None
        content = os.read(self._reports, NUMBER.size)
        return NUMBER.unpack(content)[0] if content else int(signal.SIGKILL)


def _poll(descriptor: int, event: int) -> select.poll:
    poll = select.poll()
    poll.register(descriptor, event)
    return poll


def _shown_bytes(content: bytes | bytearray) -> str:
    return repr(bytes(content[:SHOWN])).removeprefix("b")


def _end(process: int, reports: int, files: Sequence[int]) -> None:
    for file in files:
        os.close(file)
    reported = _poll(reports, select.POLLIN)
    if not reported.poll(0):
        for number in (*descendants(process), process):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(number, signal.SIGKILL)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process, signal.SIGKILL)
        reported.poll(1000 * ENDING)
    os.close(reports)

"""The processes of trackers, as the bench sees them."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import BinaryIO, Protocol
from uuid import uuid4

from trackbench.base.errors import TrackbenchError
from trackbench.base.exit_status import how_it_ended
from trackbench.driving.descendants import descendants, end_marked, memory_of
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import GIGABYTE, Isolation
from trackbench.driving.launch import INSIDE, REPORT, Launch

FORK_SERVER = "trackbench.driving.fork_server"
#: Whether messages keep their bounds, which macOS does not offer. Nothing here needs them: one launch is under way at a
#: time, and reports are of one length.
PACKETS = sys.platform == "linux"
#: How often the bench looks whether a process is still there, and what memory it takes, while it waits for it, s.
GLANCE = 0.1
#: How long a process that has been told to end may take to write down where it was, s.
DUMPING = 1.0
#: How long a start may take, and the end of all that was started, s.
STARTING, ENDING = 60.0, 10.0
#: Variables of the environment that a tracker is not told.
UNTOLD = ("TRACKBENCH_DATA", "PYTEST_CURRENT_TEST")


class Closeable(Protocol):
    """A file or socket."""

    def close(self) -> None: ...


class ForkServer:
    """The process that starts those of trackers, as the bench speaks to it.

    Args:
        output: descriptor of the file to which what trackers print goes, which is no part of a result.
    """

    def __init__(self, output: int) -> None:
        self._control, theirs = socket.socketpair(
            socket.AF_UNIX, socket.SOCK_SEQPACKET if PACKETS else socket.SOCK_STREAM
        )
        self._mark = f"{INSIDE}={uuid4()}"
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
        # A process may be ended by the garbage collector while a report is waited for.
        self._lock = threading.RLock()
        self._started: list[int] = []
        self._running: set[int] = set()
        self._statuses: dict[int, int] = {}

    @property
    def ended(self) -> bool:
        """Whether it was killed."""
        return self._process.poll() is not None

    def start(self, launch: Launch, descriptors: Sequence[int]) -> int:
        """Start the process of a tracker; return its number.

        Args:
            launch: what is started.
            descriptors: two files of it: of a program its standard input and output; of a tracker in Python its
                connection to the bench, and the file to which its traceback goes when a fault kills it.

        Raises:
            TrackbenchError: no process can be started.
        """
        with self._lock:
            self._control.settimeout(STARTING)
            try:
                socket.send_fds(self._control, [launch.packed()], descriptors)
                while not self._started:
                    self._receive_report()
                return self._started.pop()
            except (OSError, EOFError) as error:
                self._process.kill()
                raise TrackbenchError("no process can be started for a tracker") from error
            finally:
                self._control.settimeout(None)

    def status_of(self, process: int, seconds: float) -> int | None:
        """Return how a process ended, as ``os.waitpid`` does; None where it has not within some time."""
        until = time.monotonic() + seconds
        with self._lock:
            try:
                while process not in self._statuses:
                    self._control.settimeout(max(1e-3, until - time.monotonic()))
                    self._receive_report()
            except (OSError, EOFError):
                return None
            finally:
                self._control.settimeout(None)
            return self._statuses[process]

    def end(self, process: int) -> None:
        """End a process with all that it has started, and wait for it."""
        if process in self._statuses:
            return
        for number in (*descendants(process), process):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(number, signal.SIGKILL)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process, signal.SIGKILL)
        self.status_of(process, ENDING)

    def end_all(self) -> None:
        """End all processes of trackers, and wait for them."""
        for process in list(self._running):
            self.end(process)

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

    def _receive_report(self) -> None:
        content = self._control.recv(REPORT.size)
        if len(content) < REPORT.size:
            raise EOFError
        is_start, process, status = REPORT.unpack(content)
        if is_start:
            self._started.append(process)
            self._running.add(process)
        else:
            self._running.discard(process)
            self._statuses[process] = status


class ChildProcess:
    """A process of a tracker.

    Args:
        isolation: the longest that it may take to answer, and the most memory.
        launch: what is started.
        descriptors: two files of it, as of ``ForkServer.start``.
        own: files of the bench that are closed with it.
    """

    def __init__(
        self, isolation: Isolation, launch: Launch, descriptors: Sequence[int], own: Sequence[Closeable]
    ) -> None:
        self.timeout, self._most = isolation.timeout, isolation.bytes
        self.fault: TrackFault | None = None
        """Why it has ended."""
        self._taken = 0
        self._next_weighing = 0.0
        self._server = _fork_server()
        self._number = self._server.start(launch, descriptors)
        self._end = weakref.finalize(self, _end, self._server, self._number, own)

    def close(self) -> None:
        """End the process."""
        if self.fault is None:
            self.fault = TrackFault("its process was closed", "died")
            self._end()

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended: what it has started may live on."""
        return self._server.status_of(self._number, 0.0) is not None

    @property
    def is_too_large(self) -> bool:
        """Whether it takes too much memory, together with what it has started; looked up every ``GLANCE``."""
        now = time.monotonic()
        if now >= self._next_weighing:
            self._next_weighing = now + GLANCE
            self._taken = memory_of([self._number, *descendants(self._number)], self._most)
        return self._taken > self._most

    def _how_it_ended(self) -> str:
        if self._taken > self._most:
            taken, most = self._taken / GIGABYTE, self._most / GIGABYTE
            return f"it took {taken:.3g} GB of memory, where it may take {most:.3g} GB (see --tracker-memory)"
        status = self._server.status_of(self._number, min(ENDING, self.timeout))
        if status is None:
            return "its process closed the connection"
        return how_it_ended(os.waitstatus_to_exitcode(status))

    def _abort(self) -> None:
        """Let it write down where it is."""
        with suppress(ProcessLookupError, PermissionError):
            os.kill(self._number, signal.SIGABRT)
        self._server.status_of(self._number, DUMPING)


def _environment() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in UNTOLD}
    return kept | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def _end(server: ForkServer, process: int, files: Sequence[Closeable]) -> None:
    for file in files:
        file.close()
    server.end(process)


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


_fork_servers: dict[int, ForkServer] = {}


def _fork_server() -> ForkServer:
    """Return that of this process, which may itself be a copy of one that has one."""
    own = os.getpid()
    if own not in _fork_servers or _fork_servers[own].ended:
        _fork_servers[own] = ForkServer(2 if _is_open(2) else subprocess.DEVNULL)
        atexit.register(_fork_servers[own].close)
    return _fork_servers[own]


@contextmanager
def printing_to(file: BinaryIO) -> Iterator[None]:
    """Send what trackers in processes of their own print to a file; these processes end with it."""
    own = os.getpid()
    before = _fork_servers.pop(own, None)
    server = _fork_servers[own] = ForkServer(file.fileno())
    try:
        yield
    finally:
        server.end_all()
        server.close()
        del _fork_servers[own]
        if before is not None:
            _fork_servers[own] = before

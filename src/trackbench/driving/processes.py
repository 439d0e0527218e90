"""The processes of trackers, as the bench sees them."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from trackbench.base import at_hand
from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.exit_status import how_it_ended
from trackbench.base.types import Progress, no_progress
from trackbench.base.user_code import place_in_dump
from trackbench.driving.faults import TrackFault, raise_reported
from trackbench.driving.isolation import GIGABYTE, Isolation
from trackbench.driving.wire import REPORT_SIZE, Launch, Malformed, ProcessReport, exchange_frame, receive_message

TEMPLATE = "trackbench.driving.template"
#: Whether messages keep their bounds, which macOS does not offer. Nothing here needs them: one launch is under way at a
#: time, and reports are of one length.
PACKETS = sys.platform == "linux"
#: How often the bench looks whether a process is still there while it waits for its answer, s.
GLANCE = 0.5
#: How long a process that has been told to end may take to write down where it was, s.
DUMPING = 1.0
#: How long a start may take, and the end of all that was started, s.
STARTING, ENDING = 60.0, 10.0
#: Variables of the environment that a tracker is not told.
UNTOLD = ("TRACKBENCH_DATA", "PYTEST_CURRENT_TEST")
#: Lines that are shown of what all processes of a tracker print.
SHOWN = 100
NO_ANSWER = "its process sent what is no answer"

Answer = tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]


class Closeable(Protocol):
    """A file or socket."""

    def close(self) -> None: ...


class Template:
    """The process that every tracker's process is a copy of.

    Args:
        output: descriptor of the file to which what trackers print goes, which is no part of a result.
    """

    def __init__(self, output: int) -> None:
        self._control, theirs = socket.socketpair(
            socket.AF_UNIX, socket.SOCK_SEQPACKET if PACKETS else socket.SOCK_STREAM
        )
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", TEMPLATE, str(theirs.fileno())],
                env=_environment(),
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
        self._ends: dict[int, ProcessReport] = {}
        self._names: dict[int, str] = {}
        self._lines: Counter[str] = Counter()
        self.unshown: Counter[str] = Counter()
        """Lines that were not shown, by the name of a tracker."""

    @property
    def ended(self) -> bool:
        """Whether it was killed."""
        return self._process.poll() is not None

    def copy(self, launch: Launch, descriptors: Sequence[int]) -> int:
        """Start the process of a tracker.

        Args:
            launch: what is started.
            descriptors: two files of it, as of ``guard.watch``.

        Returns:
            The number of the process that guards it.

        Raises:
            TrackbenchError: no process can be started.
        """
        with self._lock:
            self._control.settimeout(STARTING)
            # Another process of the tracker shows what this one leaves.
            name = launch.name
            launch = launch._replace(lines=SHOWN - self._lines[name])
            self._lines[name] = SHOWN
            try:
                socket.send_fds(self._control, [launch.packed()], descriptors)
                while not self._started:
                    self._message()
                process = self._started.pop()
                self._names[process] = name
                return process
            except (OSError, EOFError) as error:
                self._process.kill()
                raise TrackbenchError("no process can be started for a tracker") from error
            finally:
                self._control.settimeout(None)

    def end_of(self, process: int, seconds: float) -> ProcessReport | None:
        """How a process ended; None where it has not within some time."""
        until = time.monotonic() + seconds
        with self._lock:
            try:
                while process not in self._ends:
                    self._control.settimeout(max(1e-3, until - time.monotonic()))
                    self._message()
            except (OSError, EOFError):
                return None
            finally:
                self._control.settimeout(None)
            return self._ends[process]

    def end(self, process: int) -> None:
        """End a process with all that it has started, and wait for it."""
        if process not in self._ends:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGTERM)
            self.end_of(process, ENDING)

    def end_all(self) -> None:
        """End all processes of trackers, and wait for them."""
        for process in list(self._names):
            self.end(process)

    def close(self) -> None:
        """End it, with all that its copies have left behind."""
        self._control.close()
        try:
            self._process.wait(ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _message(self) -> None:
        report = ProcessReport.unpacked(self._control.recv(REPORT_SIZE))
        if report.started:
            self._started.append(report.process)
            return
        name = self._names.pop(report.process, None)
        if name is not None:
            self._ends[report.process] = report
            self._lines[name] -= report.lines
            self.unshown[name] += report.unshown


class GuardedProcess:
    """A process of a tracker, with its guard.

    Args:
        isolation: the longest that it may take to answer, and the most memory.
        launch: what is started.
        descriptors: two files of it, as of ``guard.watch``.
        own: files of the bench that are closed with it.
    """

    def __init__(
        self, isolation: Isolation, launch: Launch, descriptors: Sequence[int], own: Sequence[Closeable]
    ) -> None:
        self.timeout, self._memory = isolation.timeout, isolation.bytes
        self.fault: TrackFault | None = None
        """Why it has ended."""
        self._template = _template()
        self._number = self._template.copy(launch._replace(memory=self._memory), descriptors)
        self._end = weakref.finalize(self, _end, self._template, self._number, own)

    def close(self) -> None:
        """End the process."""
        if self.fault is None:
            self.fault = TrackFault("its process was closed", "died")
            self._end()

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended: what it has started may live on."""
        return self._template.end_of(self._number, 0.0) is not None

    def _how_it_ended(self) -> str:
        report = self._template.end_of(self._number, min(ENDING, self.timeout))
        if report is None:
            return "its process closed the connection"
        if report.memory:
            taken, most = report.memory / GIGABYTE, self._memory / GIGABYTE
            return f"it took {taken:.3g} GB of memory, where it may take {most:.3g} GB (see --tracker-memory)"
        return how_it_ended(os.waitstatus_to_exitcode(report.status))

    def _kill(self, by: signal.Signals, seconds: float = DUMPING) -> ProcessReport | None:
        with suppress(ProcessLookupError, PermissionError):
            os.kill(self._number, by)
        return self._template.end_of(self._number, seconds)


class TrackerProcess(GuardedProcess):
    """A process in which one tracker of a scenario lives, in Python.

    Args:
        isolation: the longest that it may take to answer, and the most memory.
        name: what its output is said to be of.
        members: of the batch that it follows.
    """

    def __init__(self, isolation: Isolation, name: str, members: int = 0) -> None:
        self._members = members
        self._exchange = 0
        self._progress: Progress = no_progress
        self.dropped: list[int] = []
        """Numbers of trackers in it that are no longer needed."""
        self._dump = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._socket, theirs = socket.socketpair()
        with theirs:
            files = (self._socket, self._dump)
            super().__init__(isolation, Launch(name), (theirs.fileno(), self._dump.fileno()), files)

    def work(self, function: str, arguments: Mapping[str, Any], progress: Progress) -> Any:
        """What a function of the bench returns that is called in the process: a tracker there is looked into.

        Args:
            function: ``module:name``. It tells of its progress, each time within the longest time of an answer.
            arguments: of text and numbers.
            progress: is told of it.

        Raises:
            InputError, TrackFault: as of ``ask``.
        """
        self._progress = progress
        try:
            values, _ = self.ask("work", function=function, arguments=arguments)
            return pickle.loads(values["returned"])
        except (InputError, TrackFault):
            raise
        except Exception:
            raise self._ended(NO_ANSWER, signal.SIGTERM) from None

    def ask(self, do: str, **request: Any) -> Answer:
        """What the process answers to a request.

        Raises:
            InputError: the tracker cannot be found or does not take its options.
            TrackFault: it failed, or its process has ended; then it is no longer asked.
        """
        if self.fault is not None:
            raise self.fault
        self._exchange += 1
        request |= {"do": do, "exchange": self._exchange, "drop": self.dropped}
        if self._exchange == 1:
            request |= {"cwd": None, "path": sys.path, "classes": at_hand.pickled()}
            # It may have been deleted.
            with suppress(FileNotFoundError):
                request["cwd"] = os.getcwd()
        try:
            content = exchange_frame(request)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"its process cannot be told this: {error}") from None
        self._until = time.monotonic() + self.timeout
        try:
            self._socket.settimeout(self.timeout)
            self._socket.sendall(content)
            self.dropped = []
            answer = receive_message(self)
            while "progress" in answer["values"]:
                done, expected = map(float, answer["values"]["progress"])
                self._until = time.monotonic() + self.timeout
                self._progress(done, expected)
                answer = receive_message(self)
            values, arrays = answer["values"], answer["arrays"]
            if values["exchange"] != self._exchange or not all(
                isinstance(each, np.ndarray | np.generic) for each in arrays.values()
            ):
                raise Malformed
            raise_reported(values, self._members)
        except TimeoutError:
            text = f"it gave no answer within {self.timeout:g} s (see --tracker-timeout)"
            raise self._ended(text, signal.SIGABRT) from None
        except (EOFError, OSError):
            raise self._ended(self._how_it_ended()) from None
        except (Malformed, AttributeError, KeyError, TypeError, ValueError):
            raise self._ended(NO_ANSWER, signal.SIGTERM) from None
        return values, arrays

    def start(self, do: str, **request: Any) -> tuple[int, dict[str, Any]]:
        """The number of what a request starts, and what it says of itself.

        Raises:
            InputError: the tracker cannot be found or does not take its options.
            TrackFault: it failed.
        """
        try:
            values, _ = self.ask(do, **request)
            return int(values["number"]), values
        except (KeyError, TypeError, ValueError):
            raise self._ended(NO_ANSWER, signal.SIGTERM) from None

    def recv_into(self, buffer: memoryview) -> int:
        """As of a socket, until the answer is overdue or the process has ended: what it has started may live on."""
        while True:
            left = self._until - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._socket.settimeout(min(left, GLANCE))
            try:
                return self._socket.recv_into(buffer)
            except TimeoutError:
                if self.has_ended:
                    raise EOFError from None

    def _ended(self, cause: str, by: signal.Signals | None = None) -> TrackFault:
        if by is not None:
            self._kill(by)
        self._dump.seek(0)
        place = place_in_dump(self._dump.read().decode(errors="replace"))
        self._end()
        self.fault = TrackFault(cause, "died", place)
        return self.fault


def _environment() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in UNTOLD}
    return kept | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def _end(template: Template, process: int, files: Sequence[Closeable]) -> None:
    for file in files:
        file.close()
    template.end(process)


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


_templates: dict[int, Template] = {}


def _template() -> Template:
    """That of this process, which may itself be a copy of one that has one."""
    own = os.getpid()
    if own not in _templates or _templates[own].ended:
        _templates[own] = Template(2 if _is_open(2) else subprocess.DEVNULL)
        atexit.register(_templates[own].close)
    return _templates[own]


@contextmanager
def printing_to(file: BinaryIO) -> Iterator[Counter[str]]:
    """Send what trackers in processes of their own print to a file; these processes end with it.

    Yields:
        At the end, by name of a tracker how many lines of its output are not in the file.
    """
    own = os.getpid()
    before = _templates.pop(own, None)
    template = _templates[own] = Template(file.fileno())
    unshown = template.unshown
    try:
        yield unshown
    finally:
        template.end_all()
        template.close()
        del _templates[own]
        if before is not None:
            _templates[own] = before


def take_unshown() -> Counter[str]:
    """By name of a tracker, how many lines of its output were not shown since the last call."""
    template = _templates.get(os.getpid())
    if template is None:
        return Counter()
    unshown, template.unshown = template.unshown, Counter()
    return unshown

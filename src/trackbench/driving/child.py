"""A process of a tracker, which answers frames by its standard input and output."""

from __future__ import annotations

import os
import pickle
import select
import signal
import time
import weakref
from collections.abc import Mapping, Sequence, Sized
from contextlib import suppress
from typing import Any

from trackbench.base import notebook_classes
from trackbench.base.errors import TrackbenchError
from trackbench.base.exit_status import how_it_ended
from trackbench.base.types import Progress
from trackbench.base.user_code import place_in_dump
from trackbench.driving.descendants import descendants, memory_of
from trackbench.driving.faults import Kind, TrackFault, reported_error
from trackbench.driving.frames import LARGEST, LENGTH, READ, NotAFrame, frame_message, message_frame
from trackbench.driving.isolation import GIGABYTE, Isolation
from trackbench.driving.processes import ENDING, NOT_STARTED, NUMBER, Launch, fork_server

#: How often the bench looks whether a process is still there, and what memory it takes, while it waits for it, s.
GLANCE = 0.1
#: How long a process that has been told to end may take to write down where it was, and how long a start may take, s.
DUMPING, STARTING = 1.0, 60.0
#: Bytes that a pipe holds, so that a batch goes through it in few pieces, where the system allows it.
PIPE = 1 << 20
#: The first byte of a MessagePack map.
MAPS = frozenset([*range(0x80, 0x90), 0xDE, 0xDF])
#: Of an answer that is no frame, characters that are shown.
SHOWN = 60
#: What Python's faulthandler writes of each call, and the most bytes of it that are read.
DUMPED, LONGEST_DUMP = b'  File "', 1 << 20


class ChildProcess:
    """A process of a tracker, which answers the frames that it is sent.

    Args:
        isolation: the longest that it may take to answer, and the most memory.
        launch: what is started.
        name: text with which messages about it begin.
    """

    def __init__(self, isolation: Isolation, launch: Launch, name: str = "") -> None:
        self.timeout, self._most, self._name = isolation.timeout, isolation.bytes, name
        self.fault: TrackFault | None = None
        """Why it has ended."""
        self.members = 0
        """Number of members of the batch that it follows."""
        self._taken, self._next_weighing = 0, 0.0
        self._status: int | None = None
        self._unsent, self._received = message_frame(launch._asdict()), bytearray()
        reading, self._out = _pipe()
        self._in, writing = _pipe()
        self._reports, reporting = _pipe()
        theirs = (reporting, reading, writing)
        try:
            fork_server().start(theirs)
        finally:
            for descriptor in theirs:
                os.close(descriptor)
        number = self._reported(STARTING)
        if number is None:
            raise TrackbenchError(NOT_STARTED)
        os.set_blocking(self._out, False)
        self._number = number
        self._end = weakref.finalize(self, _end, number, self._reports, (self._out, self._in))
        self._poll = select.poll()
        self._poll.register(self._in, select.POLLIN)

    def close(self) -> None:
        """End the process."""
        if self.fault is None:
            self.fault = TrackFault("its process was closed", "died")
            self._end()

    def send(self, frames: Sequence[bytes] = ()) -> None:
        """Send frames; the answers are to be received one by one.

        Raises:
            TrackFault: the process has ended, or does not read.
        """
        if self.fault is not None:
            raise self.fault
        self._until = time.monotonic() + self.timeout
        if self.is_too_large:
            raise self._ended()
        content, self._unsent = b"".join((self._unsent, *frames)), b""
        try:
            sent = os.write(self._out, content)
        except BlockingIOError:
            sent = 0
        except OSError:
            raise self._ended() from None
        if sent < len(content):
            self._send_rest(memoryview(content)[sent:])

    def receive(self) -> dict[str, Any]:
        """The next answer.

        Raises:
            TrackFault: the tracker failed; its process has ended, is late, or wrote what is no answer.
            InputError: the tracker cannot be found or does not take its options.
        """
        self._until = time.monotonic() + self.timeout
        self._take(LENGTH.size + 1)
        (size,) = LENGTH.unpack_from(self._received)
        if not 0 < size <= LARGEST or self._received[LENGTH.size] not in MAPS:
            raise self._no_frame()
        end = LENGTH.size + size
        self._take(end)
        content = self._received[LENGTH.size : end]
        del self._received[:end]
        try:
            answer = frame_message(content)
        except NotAFrame as error:
            raise self.failed(f"its answer is {error}; it begins with {_text(content)}") from None
        if answer.get("type") == "error":
            raise reported_error(answer, self.members, self._name)
        return answer

    def work(self, function: str, arguments: Mapping[str, Any], progress: Progress) -> Any:
        """What a function of the bench returns that is called in a process of Python: a tracker there is looked into.

        Args:
            function: ``module:name``. It tells of its progress, each time within the longest time of an answer.
            arguments: of text and numbers.
            progress: is told of it.

        Raises:
            InputError, TrackFault: as of ``receive``.
        """
        request = {
            "type": "work",
            "function": function,
            "arguments": arguments,
            "classes": notebook_classes.dumps(None),
        }
        self.send([message_frame(request)])
        while (answer := self.receive()).get("type") == "progress":
            progress(answer["done"], answer["expected"])
        try:
            return pickle.loads(answer["pickled"])
        except Exception:
            raise self.failed("its process sent what is no answer", "died") from None

    def failed(self, cause: str, kind: Kind = "answer", place: str | None = None) -> TrackFault:
        """End it, where it has not ended; return the fault."""
        self._end()
        self.fault = TrackFault(f"{self._name}{cause}", kind, place)
        return self.fault

    @property
    def is_too_large(self) -> bool:
        """Whether it takes too much memory, together with what it has started; looked up every ``GLANCE``."""
        now = time.monotonic()
        if now >= self._next_weighing:
            self._next_weighing = now + GLANCE
            self._taken = memory_of([self._number, *descendants(self._number)], self._most)
        return self._taken > self._most

    def _send_rest(self, content: memoryview) -> None:
        """Send what the pipe does not take at once, and take in meanwhile what the process answers."""
        poll = select.poll()
        poll.register(self._out, select.POLLOUT)
        poll.register(self._in, select.POLLIN)
        while content:
            ready = dict(poll.poll(GLANCE * 1000))
            if self._in in ready:
                self._read()
            if self._out in ready:
                try:
                    content = content[os.write(self._out, content) :]
                    self._until = time.monotonic() + self.timeout
                except BlockingIOError:
                    pass
                except OSError:
                    raise self._ended() from None
            self._look(ready)
            if len(self._received) > LARGEST:
                raise self.failed(f"it wrote more than {LARGEST} bytes before it read what it was sent", "died")

    def _take(self, size: int) -> None:
        """Read until as many bytes have come."""
        while len(self._received) < size:
            if ready := self._poll.poll(GLANCE * 1000):
                self._read()
            if len(self._received) < size:
                self._look(ready)

    def _read(self) -> None:
        content = os.read(self._in, READ)
        if not content:
            raise self._ended()
        self._received += content

    def _look(self, ready: Sized) -> None:
        """Raise where the process is late, takes too much memory or, where nothing is ready, has ended."""
        if self.is_too_large or (not ready and self._ended_within(0.0)):
            raise self._ended()
        if time.monotonic() >= self._until:
            stray = f"; it wrote {_text(self._received)}" if self._received else ""
            # So it writes down where it is.
            with suppress(ProcessLookupError, PermissionError):
                os.kill(self._number, signal.SIGABRT)
            self._ended_within(DUMPING)
            cause = f"it gave no answer within {self.timeout:g} s (see --tracker-timeout){stray}"
            raise self.failed(cause, "died", self._place())

    def _ended(self) -> TrackFault:
        cause = "its process closed the connection"
        if self._taken > self._most:
            taken, most = self._taken / GIGABYTE, self._most / GIGABYTE
            cause = f"it took {taken:.3g} GB of memory, where it may take {most:.3g} GB (see --tracker-memory)"
        elif self._ended_within(min(ENDING, self.timeout)) and self._status is not None:
            cause = how_it_ended(os.waitstatus_to_exitcode(self._status))
        return self.failed(cause, "died", self._place())

    def _no_frame(self) -> TrackFault:
        # More of what it writes tells more.
        self._place(0.1)
        if DUMPED in self._received and self._ended_within(DUMPING):
            return self._ended()
        hint = "what a program prints belongs on standard error"
        return self.failed(f"its standard output is no frame: it begins with {_text(self._received)}; {hint}")

    def _place(self, patience: float = 0.0) -> str | None:
        """Read what comes within ``patience`` s; return the line of the tracker's code that Python wrote there."""
        while len(self._received) < LONGEST_DUMP and self._poll.poll(1000 * patience):
            content = os.read(self._in, READ)
            if not content:
                break
            self._received += content
        return place_in_dump(self._received.decode(errors="replace"))

    def _ended_within(self, seconds: float) -> bool:
        """Whether the process ends within some time: what it has started may live on."""
        if self._status is None:
            self._status = self._reported(seconds)
        return self._status is not None

    def _reported(self, seconds: float) -> int | None:
        """The next number that the fork server reports; that of SIGKILL where it has ended, with all its processes."""
        if not select.select([self._reports], [], [], seconds)[0]:
            return None
        content = os.read(self._reports, NUMBER.size)
        return NUMBER.unpack(content)[0] if content else int(signal.SIGKILL)


def _pipe() -> tuple[int, int]:
    ends = os.pipe()
    with suppress(OSError, AttributeError, ImportError):
        import fcntl

        fcntl.fcntl(ends[1], fcntl.F_SETPIPE_SZ, PIPE)
    return ends


def _text(content: bytes | bytearray) -> str:
    """The first bytes of what is no frame, as text."""
    return repr(bytes(content[:SHOWN])).removeprefix("b")


def _end(process: int, reports: int, files: Sequence[int]) -> None:
    """End a process with all that it has started, and wait for it."""
    for file in files:
        os.close(file)
    if not select.select([reports], [], [], 0.0)[0]:
        for number in (*descendants(process), process):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(number, signal.SIGKILL)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process, signal.SIGKILL)
        select.select([reports], [], [], ENDING)
    os.close(reports)

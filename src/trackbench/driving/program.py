"""A program in another language that follows objects, as the bench speaks to it."""

from __future__ import annotations

import os
import platform
import select
import time
from collections.abc import Mapping, Sequence, Sized
from contextlib import suppress
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError, printable, shortened_text
from trackbench.base.types import Scan
from trackbench.driving import frames
from trackbench.driving.faults import Kind, TrackFault
from trackbench.driving.frames import LARGEST, LENGTH, READ, NotAFrame, message_frame
from trackbench.driving.isolation import Isolation, lacking
from trackbench.driving.launch import Launch
from trackbench.driving.processes import GLANCE, ChildProcess
from trackbench.models.sensors import Sensor
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.foreign import Command

#: Bytes that a pipe holds, so that a batch goes through it in few pieces, where the system allows it.
PIPE = 1 << 20
#: The first byte of a MessagePack map.
MAPS = frozenset([*range(0x80, 0x90), 0xDE, 0xDF])
#: Of an answer that is no frame, characters that are shown.
SHOWN = 60


class Program(ChildProcess):
    """A program that serves trackers, each with a number.

    Args:
        config: names it.
        folder: where its path starts, and where it runs.
        isolation: the longest that it may take to answer, and the most memory.
        several: whether it is to follow several objects.
        batch: how many members the bench follows at once.
        sensors: of the scenario, by name.

    Raises:
        InputError: there is no such program, or it cannot be told the options.
        TrackFault: it does not answer, or not as the protocol says.
    """

    def __init__(
        self,
        config: PluginConfig,
        folder: Path | None,
        isolation: Isolation,
        several: bool,
        batch: int = 1,
        sensors: Mapping[str, Sensor] = {},
    ) -> None:
        assert isinstance(config.use, Command)
        if missing := lacking():
            raise InputError(f"programs cannot be started: {platform.system()} has no {missing}", key="use")
        self.name = config.use.name
        hello = _hello(config, several, batch, sensors)
        command = config.use.resolved(folder)
        reading, self._out = _pipe()
        self._in, writing = _pipe()
        own = (os.fdopen(self._out, "wb", 0), os.fdopen(self._in, "rb", 0))
        os.set_blocking(self._out, False)
        launch = Launch(
            config.use.name,
            command=command,
            folder=str((folder or Path.cwd()).resolve()),
            python_path=os.environ.get("PYTHONPATH"),
        )
        try:
            super().__init__(isolation, launch, (reading, writing), own)
        finally:
            os.close(reading)
            os.close(writing)
        self._poll = select.poll()
        self._poll.register(self._in, select.POLLIN)
        self._unsent, self._received = hello, bytearray()
        self._numbers = 0
        self.send([])
        self._understand(self.receive())

    def start(self) -> int:
        """The number of a fresh tracker."""
        self._numbers += 1
        self._unsent += message_frame({"type": "start", "id": self._numbers})
        return self._numbers

    def copy(self, number: int) -> int:
        """The number of a copy of a tracker, with its state."""
        self._numbers += 1
        self._unsent += message_frame({"type": "copy", "id": self._numbers, "of": number})
        return self._numbers

    def end(self, number: int) -> None:
        """A tracker is no longer needed."""
        if self.fault is None:
            self._unsent += message_frame({"type": "end", "id": number})

    def send(self, messages: Sequence[bytes]) -> None:
        """Send frames; the answers are to be received one by one.

        Raises:
            TrackFault: the program has ended, or does not read.
        """
        if self.fault is not None:
            raise self.fault
        self._until = time.monotonic() + self.timeout
        if self.is_too_large:
            raise self._ended()
        content, self._unsent = b"".join((self._unsent, *messages)), b""
        try:
            sent = os.write(self._out, content)
        except BlockingIOError:
            sent = 0
        except OSError:
            raise self._ended() from None
        if sent < len(content):
            self._send_rest(memoryview(content)[sent:])

    def receive(self, number: int | None = None) -> dict[str, Any]:
        """The next answer.

        Args:
            number: of the tracker that was asked; None of the first answer of all.

        Raises:
            TrackFault: the program says that it failed, has ended, is late, or wrote what is no answer.
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
            answer = frames.frame_message(content)
        except NotAFrame as error:
            raise self.failed(f"its answer is {error}; it begins with {_text(content)}") from None
        kind = answer.get("type")
        if kind == "error":
            raise TrackFault(f"{self.name}: {_line(str(answer.get('message')))}", "raised")
        if number is not None and (kind not in ("estimate", "none", "tracks") or answer.get("id") != number):
            asked = f"a scan of tracker {number}"
            raise self.failed(f"it answered {asked} with {_said(kind)} of {_said(answer.get('id'))}")
        return answer

    def failed(self, cause: str, kind: Kind = "answer") -> TrackFault:
        """End it, where it has not ended; return the fault."""
        self._end()
        self.fault = TrackFault(f"{self.name}: {cause}", kind)
        return self.fault

    def ask(self, number: int, scan: Scan) -> dict[str, Any]:
        """What a tracker answers to a scan."""
        self.send([frames.ScanFrames(scan).of(frames.id_of(number), scan)])
        return self.receive(number)

    def _understand(self, answer: Mapping[str, Any]) -> None:
        version = answer.get("version")
        if answer.get("type") != "hello" or type(version) is not int:
            raise self.failed(f"it answered hello with {_said(answer.get('type'))}, where hello with a version is due")
        if version != frames.VERSION:
            raise self.failed(f"it speaks version {version} of the protocol, and this trackbench {frames.VERSION}")
        self.batched, self.random, self.copies = (answer.get(name) is True for name in ("batched", "random", "copies"))

    def _send_rest(self, content: memoryview) -> None:
        """Send what the pipe does not take at once, and take in meanwhile what the program answers."""
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
        """Raise where the program is late, takes too much memory or, where nothing is ready, has ended."""
        if self.is_too_large or (not ready and self.has_ended):
            raise self._ended()
        if time.monotonic() >= self._until:
            stray = f"; it wrote {_text(self._received)}" if self._received else ""
            raise self.failed(f"it gave no answer within {self.timeout:g} s (see --tracker-timeout){stray}", "died")

    def _ended(self) -> TrackFault:
        return self.failed(self._how_it_ended(), "died")

    def _no_frame(self) -> TrackFault:
        # More of what it prints tells more.
        while len(self._received) < SHOWN and self._poll.poll(100) and (more := os.read(self._in, READ)):
            self._received += more
        hint = "what a program prints belongs on standard error"
        return self.failed(f"its standard output is no frame: it begins with {_text(self._received)}; {hint}")


def _hello(config: PluginConfig, several: bool, batch: int, sensors: Mapping[str, Sensor]) -> bytes:
    hello = {
        "type": "hello",
        "version": frames.VERSION,
        "identities": "hidden" if several else "known",
        "batch": batch,
        "sensors": [
            {
                "name": name,
                "kind": sensor.type,
                "components": list(sensor.components),
                "noise_covariance": frames.packed_array(sensor.noise_covariance()),
            }
            for name, sensor in sensors.items()
        ],
        "options": config.options,
    }
    try:
        return message_frame(hello)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a program cannot be told these options: {error}", key="options") from None


def _pipe() -> tuple[int, int]:
    ends = os.pipe()
    with suppress(OSError, AttributeError, ImportError):
        import fcntl

        fcntl.fcntl(ends[1], fcntl.F_SETPIPE_SZ, PIPE)
    return ends


def _line(text: str) -> str:
    return shortened_text(" ".join(printable(text).split()))


def _text(content: bytes | bytearray) -> str:
    """The first bytes of what is no frame, as text."""
    return repr(bytes(content[:SHOWN])).removeprefix("b")


def _said(value: Any) -> str:
    return shortened_text(repr(value), SHOWN)

"""The process that a shell sees: it waits for the one in which a command runs, and answers for it.

A plug-in that is no tracker runs in the process of the command, and may end it in many ways. Only a status that the
command has told is a result.
"""

from __future__ import annotations

import json
import mmap
import os
import re
import select
import shutil
import signal
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from trackbench.base import supervised
from trackbench.base.descendants import adopt_orphans, children, descendants, end_children, end_descendants
from trackbench.base.process import BAD_INPUT, FAULT, INTERRUPTED, clear_of_streams, how_it_ended

#: Options of commands that run no plug-in, or want none between them and the terminal.
UNSUPERVISED = {"--help", "-h", "--version", "--in-process"}
#: Bytes of what the command tells that are kept.
KEPT = 2**18
#: How long the process of a command that has told its status, or was told to end, may go on, s.
FAREWELL = 5.0
#: How long it may go on after its connection was closed, as by its own end, s.
CLOSING = 0.5
#: How long helpers of the command may go on after it, s.
HELPERS = 1.0
#: When a signal to end is sent on, s. Ctrl-C goes to both processes, and two signals at once may be taken by another
#: thread of the command than the one that sleeps, which then sleeps on. What comes meanwhile is the same signal.
AT_ONCE = 0.3
#: Statuses that say that there is a result.
WITH_RESULT = {0, 1, 3}
#: The command is killed at the so many-th.
IMPATIENT = 3
ENDING = {number for number in signal.Signals if number.name in ("SIGINT", "SIGTERM", "SIGHUP")}


def wanted(arguments: Sequence[str]) -> bool:
    """Whether a command with these arguments is to have a supervisor."""
    if not hasattr(os, "fork"):
        return False
    traced = sys.gettrace() is not None or (sys.version_info >= (3, 12) and sys.monitoring.get_tool(0) is not None)
    completed = any(name.endswith("_COMPLETE") for name in os.environ)
    return bool(arguments) and not traced and not completed and UNSUPERVISED.isdisjoint(arguments)


def start_supervised() -> None:
    """Go on in a new process, which is supervised; the one that called this never returns."""
    here = os.getpid()
    # What is ignored, as by a script that starts it in the background, stays so.
    signals = {number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*signals, signal.SIGCHLD})
    reading, writing = map(clear_of_streams, os.pipe())
    note = mmap.mmap(-1, supervised.NOTE)
    process = os.fork()
    if process:
        os.close(writing)
        _Supervisor(process, reading, note, signals).wait(before)
    os.close(reading)
    supervised.begin(here, writing, note)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Supervisor:
    def __init__(self, process: int, pipe: int, note: mmap.mmap, signals: set[signal.Signals]) -> None:
        self._process, self._pipe, self._note, self._signals = process, pipe, note, signals
        self._told = b""
        self._open = True
        self._ended: int | None = None
        self._overdue = False
        self._until = self._sending = float("inf")
        self._interruptions = 0

    def wait(self, mask: Iterable[int]) -> NoReturn:
        """Wait for the command, and give its status to the shell."""
        adopt_orphans()
        successor = self._start_successor()
        waking, wake = map(clear_of_streams, os.pipe())
        for end in (waking, wake):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        for number in (*self._signals, signal.SIGCHLD):
            signal.signal(number, lambda *_: None)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        while self._ended is None:
            left = max(0.0, min(self._until, self._sending) - time.monotonic())
            ready, _, _ = select.select([waking, *([self._pipe] if self._open else [])], [], [], min(left, 3600.0))
            if time.monotonic() > self._until:
                self._overdue = True
                os.kill(self._process, signal.SIGKILL)
            if time.monotonic() > self._sending:
                self._sending = float("inf")
                os.kill(self._process, signal.SIGTERM if self._interruptions < IMPATIENT else signal.SIGKILL)
            if self._pipe in ready:
                self._read()
            if waking in ready:
                self._take_signals(waking)
            self._reap()
        # One that came with what has ended the command.
        with suppress(BlockingIOError):
            self._take_signals(waking)
        while self._open and select.select([self._pipe], [], [], 0.0)[0]:
            self._read()
        self._end_helpers(successor)
        end_children(successor, signal.SIGKILL)
        status = self._status()
        # None where it was closed from the start.
        with suppress(OSError, AttributeError):
            sys.stderr.flush()
        os._exit(status)

    def _read(self) -> None:
        content = os.read(self._pipe, 65536)
        self._told = (self._told + content)[-KEPT:]
        self._open = bool(content)
        if self._answered or not self._open:
            self._until = min(self._until, time.monotonic() + (FAREWELL if self._answered else CLOSING))

    def _values(self, key: str) -> list[str]:
        return re.findall(rf"^{key} (.+)$", self._told.decode(errors="surrogateescape"), re.MULTILINE)

    @property
    def _answered(self) -> bool:
        return bool(self._values("status"))

    def _take_signals(self, waking: int) -> None:
        for number in self._signals.intersection(os.read(waking, 4096)):
            self._interrupt(number)

    def _interrupt(self, number: int) -> None:
        if self._sending < float("inf"):
            return
        now = time.monotonic()
        self._interruptions += 1
        self._sending = now + AT_ONCE
        if number != signal.SIGINT:
            self._until = min(self._until, now + FAREWELL)

    def _reap(self) -> None:
        """Note the end of the command, and wait for orphans that have ended."""
        with suppress(ChildProcessError):
            while True:
                process, status = os.waitpid(-1, os.WNOHANG)
                if process == 0:
                    return
                if process == self._process:
                    self._ended = status

    def _start_successor(self) -> list[int]:
        """Start a process that kills the command where this one is killed and the command does not end by itself.

        It may be in machine code, which Python's signals do not reach. Returns its number; nothing where there is none.
        """
        if not hasattr(os, "pidfd_open"):
            return []
        command, waiting, held = map(clear_of_streams, (os.pidfd_open(self._process), *os.pipe()))
        if own := os.fork():
            os.close(waiting)
            os.close(command)
            return [own]
        os.closerange(0, 3)
        os.close(held)
        os.close(self._pipe)
        # To the end of the process that holds the other end.
        select.select([waiting], [], [])
        if not select.select([command], [], [], FAREWELL)[0]:
            for process in (*descendants(self._process), self._process):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
        os._exit(0)

    def _end_helpers(self, successor: list[int]) -> None:
        kept = {*map(int, self._values("kept")), *successor}
        until = time.monotonic() + HELPERS
        while set(children(os.getpid())) - kept and time.monotonic() < until:
            self._reap()
            time.sleep(0.005)
        end_descendants(kept)

    def _lost(self) -> str:
        """The first file that is not as the command says it has written it, where plug-ins were loaded; else empty."""
        if not self._values("plugin"):
            return ""
        for place, seals in dict(map(json.loads, self._values("written"))).items():
            for name, seal in seals.items():
                file = Path(place, name)
                if not seal or supervised.seal_of(file) != seal:
                    return str(file)
        return ""

    def _status(self) -> int:
        signals = [value.partition(" ") for value in self._values("signal")]
        status = int(self._values("status")[-1]) if self._answered else None
        for text in self._values("unsaid"):
            _say(json.loads(text))
        if status is not None and not (signals and status == INTERRUPTED):
            if status not in WITH_RESULT or not (lost := self._lost()):
                return status
            _say(
                f"trackbench: no result: {lost} is not there as it was written, "
                f"{supervised.with_plugins(self._values('plugin'))}"
            )
            return BAD_INPUT
        for folder in self._values("scratch"):
            shutil.rmtree(folder, ignore_errors=True)
        number, _, at_work = signals[-1] if signals else ("", "", "")
        if self._interruptions or (signals and not at_work):
            # One that does not listen to signals has told of none.
            at_work = at_work or self._note[:].rstrip(b"\0").decode(errors="replace")
            meanwhile = f" while {at_work} was at work" if at_work else ""
            kept = [json.loads(text) for text in self._values("resumable")] or [supervised.UNFINISHED]
            _say(f"interrupted{meanwhile}: {kept[-1]}")
            return INTERRUPTED
        assert self._ended is not None
        note, plugins = at_work.encode() or self._note[:], self._values("plugin")
        cause = how_it_ended(os.waitstatus_to_exitcode(self._ended))
        if self._overdue:
            cause = "its process became another program, or closed its files"
        elif signals:
            cause = f"its process alone was sent signal {number} ({signal.Signals(int(number)).name})"
        _say(f"trackbench: no result: {supervised.end_in_words(cause, self._told, note, plugins)}")
        return BAD_INPUT if note.strip(b"\0") or plugins else FAULT


def _say(text: str) -> None:
    """On stderr, where a progress bar may have been cut short, with the cursor hidden."""
    start = "\r\x1b[K\x1b[?25h" if sys.stderr is not None and sys.stderr.isatty() else ""
    with suppress(OSError, ValueError):
        print(f"{start}{text}", file=sys.stderr, flush=True)

"""The process that starts that of a tracker, watches it, and ends it with all that it has started.

It runs no code of a tracker, and there is one for each.
"""

from __future__ import annotations

import codecs
import os
import select
import signal
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from trackbench.driving import execute, host
from trackbench.driving.descendants import adopt_orphans, descendants, end_descendants, end_with_parent
from trackbench.driving.printed import Shown
from trackbench.driving.wire import LAST, Launch, ProcessReport

#: Between two looks at the memory, s.
INTERVAL = 0.1


def watch(control: socket.socket, descriptors: Sequence[int], launch: Launch, template: int) -> NoReturn:
    """Start the process of a tracker, and report its end, in a process that was just started.

    Args:
        control: takes the report.
        descriptors: files of the tracker's process: of a program its standard input and output; of a tracker in Python
            its connection to the bench, and the file to which its traceback goes when it is killed by a fault.
        launch: what is started, and what it may take and print.
        template: number of the process that started this one.
    """
    guard = _Guard(control, launch, template)
    end_with_parent(template, signal.SIGTERM)
    adopt_orphans()
    guard.start(descriptors)
    guard.wait()
    os._exit(0)


class _Guard:
    def __init__(self, control: socket.socket, launch: Launch, template: int) -> None:
        self._control, self._launch, self._template = control, launch, template
        self._shown = Shown(launch.name, launch.lines)
        self._last = b""
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._memory = self._host = 0
        self._status: int | None = None
        self._ending = False
        self._next_look = 0.0
        self._output, self._printing = os.pipe()
        self._waking, wake = os.pipe()
        for end in (self._waking, wake, self._output):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.signal(signal.SIGTERM, self._end)
        signal.signal(signal.SIGABRT, lambda *_: os.kill(self._host, signal.SIGABRT))
        signal.pthread_sigmask(signal.SIG_SETMASK, set())

    def start(self, descriptors: Sequence[int]) -> None:
        own = os.getpid()
        self._host = os.fork()
        if self._host == 0:
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGABRT):
                signal.signal(number, signal.SIG_DFL)
            end_with_parent(own, signal.SIGKILL)
            self._control.close()
            os.dup2(self._printing, 1)
            os.dup2(self._printing, 2)
            if self._launch.command:
                execute.become(descriptors, self._launch)
            host.serve_bench(socket.socket(fileno=descriptors[0]), descriptors[1], self._launch.name)
        for descriptor in (*descriptors, self._printing):
            os.close(descriptor)

    def wait(self) -> None:
        """Until the process has ended, or is to end, with all that it has started; then report it."""
        poll = select.poll()
        poll.register(self._waking, select.POLLIN)
        poll.register(self._output, select.POLLIN)
        while self._status is None and not self._ending:
            ready = dict(poll.poll(INTERVAL * 1000))
            if self._waking in ready:
                os.read(self._waking, 4096)
            if ready.get(self._output, 0) & (select.POLLHUP | select.POLLERR) and not self._show():
                # It has closed its output.
                poll.unregister(self._output)
            self._show()
            self._reap()
            self._weigh()
            # Where no signal tells of it.
            self._ending = self._ending or os.getppid() != self._template
        with suppress(ProcessLookupError, PermissionError):
            # Its group, which is all that is known of its children where it is not Linux.
            os.killpg(self._host, signal.SIGKILL)
        end_descendants()
        self._show()
        status = signal.SIGKILL if self._status is None else self._status
        with suppress(OSError):
            shown, last = self._shown, self._last if self._launch.command else b""
            report = ProcessReport(False, os.getpid(), status, self._memory, shown.unshown, shown.lines, last)
            self._control.send(report.packed())

    def _end(self, *_: object) -> None:
        self._ending = True

    def _show(self) -> int:
        """Send on what was printed, up to the limit; return the number of bytes."""
        total = 0
        with suppress(BlockingIOError):
            # No more at a time than a pipe holds, since one may print without end.
            for _ in range(16):
                content = os.read(self._output, 65536)
                total += len(content)
                self._last = (self._last + content)[-LAST:]
                if text := self._shown.admit(self._decoder.decode(content)):
                    with suppress(OSError):
                        os.write(2, text.encode())
        return total

    def _reap(self) -> None:
        with suppress(ChildProcessError):
            while self._status is None:
                process, status = os.waitpid(-1, os.WNOHANG)
                if process == self._host:
                    self._status = status
                if process == 0:
                    return

    def _weigh(self) -> None:
        """End the process where it takes too much memory, together with what it has started."""
        if time.monotonic() < self._next_look:
            return
        self._next_look = time.monotonic() + INTERVAL
        processes = list(descendants(os.getpid()))
        if sum(map(_resident, processes)) <= self._launch.memory:
            return
        # What several share counts once.
        memory = sum(map(_proportional, processes))
        if memory > self._launch.memory:
            self._memory, self._ending = memory, True


def _resident(process: int) -> int:
    """Resident memory of a process, bytes; 0 where it has ended."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


def _proportional(process: int) -> int:
    """The same, with its share of what it shares with other processes."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return _resident(process)
    return next((int(line.split()[1]) * 1024 for line in text.splitlines() if line.startswith("Pss:")), 0)

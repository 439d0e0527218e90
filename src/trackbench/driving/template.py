"""The process that the processes of trackers are copies of: it has imported what they need, and knows nothing else.

Run as ``python -m trackbench.driving.template DESCRIPTOR``, by :mod:`trackbench.driving.processes`.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path

from trackbench.driving import host
from trackbench.driving.wire import INSIDE, REPORT

#: prctl(2)
PR_SET_CHILD_SUBREAPER = 36


def adopt_orphans() -> None:
    """Become the parent of every descendant whose own parent ends, also of those in sessions of their own."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def end_descendants() -> None:
    """Kill whatever descends from this process."""
    while children := _children(os.getpid()):
        for process in children:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(process, 0)


def _children(process: int) -> list[int]:
    try:
        return [int(number) for number in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


def main(descriptor: int) -> None:
    """Copy this process for each pair of descriptors that comes, until the bench ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[INSIDE] = "1"
    adopt_orphans()
    bench = os.getppid()
    with socket.socket(fileno=descriptor) as control:

        def ended(*_: object) -> None:
            while True:
                try:
                    process, status = os.waitpid(-1, os.WNOHANG)
                except ChildProcessError:
                    return
                if process == 0:
                    return
                control.send(REPORT.pack(False, process, status))

        signal.signal(signal.SIGCHLD, ended)
        while True:
            try:
                _, descriptors, _, _ = socket.recv_fds(control, 1, 2)
            except ConnectionResetError:
                return
            if not descriptors:
                return
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
            process = os.fork()
            if process == 0:
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
                control.close()
                host.serve(socket.socket(fileno=descriptors[0]), descriptors[1], bench)
            for number in descriptors:
                os.close(number)
            control.send(REPORT.pack(True, process, 0))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})


if __name__ == "__main__":
    # The bench may end, or be killed, before it is told what has become of a copy.
    with suppress(BrokenPipeError):
        main(int(sys.argv[1]))
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    end_descendants()

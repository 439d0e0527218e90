"""The process that the processes of trackers are copies of: it has imported what they need, and knows nothing else.

Run as ``python -m trackbench.driving.template DESCRIPTOR``, by :mod:`trackbench.driving.processes`. A copy is a guard,
which starts the tracker's process and ends it.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from contextlib import suppress

from trackbench.driving import guard
from trackbench.driving.descendants import adopt_orphans, end_children, end_descendants
from trackbench.driving.wire import INSIDE, LONGEST_LAUNCH, Launch, ProcessReport

#: How often it looks whether the bench is still there, s.
ORPHANED = 2.0


def _main(descriptor: int) -> None:
    """Copy this process for each pair of descriptors that comes, until the bench ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ[INSIDE] = "1"
    adopt_orphans()
    bench, own = os.getppid(), os.getpid()
    guards: set[int] = set()
    with socket.socket(fileno=descriptor) as control:

        def ended(*_: object) -> None:
            with suppress(ChildProcessError):
                while (end := os.waitpid(-1, os.WNOHANG))[0] != 0:
                    process, status = end
                    if process in guards and status != 0:
                        # It was killed: what it should have ended has become a child of this process.
                        end_descendants(guards)
                        with suppress(OSError):
                            control.send(ProcessReport(False, process, status).packed())
                    guards.discard(process)

        signal.signal(signal.SIGCHLD, ended)
        control.settimeout(ORPHANED)
        while True:
            try:
                launch, descriptors, _, _ = socket.recv_fds(control, LONGEST_LAUNCH, 2)
            except TimeoutError:
                if os.getppid() != bench:
                    break
                continue
            except ConnectionResetError:
                break
            if not descriptors:
                break
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
            process = os.fork()
            if process == 0:
                control.settimeout(None)
                guard.watch(control, descriptors, Launch.unpacked(launch), own)
            guards.add(process)
            for number in descriptors:
                os.close(number)
            control.send(ProcessReport(True, process).packed())
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        end_children(guards, signal.SIGTERM)


if __name__ == "__main__":
    # The bench may end, or be killed, before it is told what has become of a copy.
    with suppress(BrokenPipeError):
        _main(int(sys.argv[1]))
    end_descendants()

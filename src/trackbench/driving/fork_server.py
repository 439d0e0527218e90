"""The process that starts the processes of trackers: it has imported what they need, and holds no truth.

Run as ``python -m trackbench.driving.fork_server DESCRIPTOR``, by :mod:`trackbench.driving.processes`.
"""

from __future__ import annotations

import os
import resource
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

from trackbench.driving import host
from trackbench.driving.descendants import adopt_orphans, end_children, end_descendants, end_with_parent
from trackbench.driving.frames import message_frame
from trackbench.driving.launch import LONGEST_LAUNCH, REPORT, Launch

#: How often it looks whether the bench is still there, s.
ORPHANED = 2.0


def serve(descriptor: int) -> None:
    """Start a process for each launch that comes, and report how each ends, until the bench ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    adopt_orphans()
    bench, running = os.getppid(), set[int]()
    with socket.socket(fileno=descriptor) as control:

        def report_ends(*_: object) -> None:
            with suppress(ChildProcessError):
                while (end := os.waitpid(-1, os.WNOHANG))[0] != 0:
                    process, status = end
                    if process not in running:
                        continue
                    running.discard(process)
                    with suppress(ProcessLookupError, PermissionError):
                        os.killpg(process, signal.SIGKILL)
                    if not running:
                        end_descendants()
                    with suppress(OSError):
                        control.send(REPORT.pack(False, process, status))

        signal.signal(signal.SIGCHLD, report_ends)
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
            own, process = os.getpid(), os.fork()
            if process == 0:
                control.close()
                _become_tracker(own, descriptors, Launch.unpacked(launch))
            running.add(process)
            for number in descriptors:
                os.close(number)
            control.send(REPORT.pack(True, process, 0))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        end_children(running, signal.SIGKILL)


def _become_tracker(server: int, descriptors: Sequence[int], launch: Launch) -> NoReturn:
    """Serve the bench in this process, in a session of its own, or replace the process by a program."""
    # A group of its own, which a tracker may kill.
    os.setsid()
    end_with_parent(server, signal.SIGKILL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if launch.command is None:
        host.serve_bench(socket.socket(fileno=descriptors[0]), descriptors[1], launch.name)
    # What Python ignores.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    for stream, descriptor in enumerate(descriptors):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if launch.python_path is not None:
        environment["PYTHONPATH"] = launch.python_path
    try:
        os.chdir(launch.folder)
        os.execve(launch.command[0], launch.command, environment)
    except (OSError, ValueError) as error:
        os.write(1, message_frame({"type": "error", "message": f"it cannot be started: {error}"}))
        # The bench speaks first; a pipe that nobody reads would hide the reason.
        os.read(0, 1)
    os._exit(1)


if __name__ == "__main__":
    # The bench may end, or be killed, before it is told what has become of a process.
    with suppress(BrokenPipeError):
        serve(int(sys.argv[1]))
    end_descendants()

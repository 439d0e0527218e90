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
from trackbench.driving.frames import message_frame, read_message
from trackbench.driving.processes import HOST, NUMBER, Launch

#: How often it looks whether the bench is still there, s.
ORPHANED = 2.0


def serve(descriptor: int) -> None:
    """Start a process whenever descriptors come, and report how each ends, until the bench ends.

    The descriptors are those for reports, standard input, standard output and, where the bench sends a fourth one,
    standard error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    adopt_orphans()
    bench, reports = os.getppid(), dict[int, int]()

    def report_ends(*_: object) -> None:
        with suppress(ChildProcessError):
            while (end := os.waitpid(-1, os.WNOHANG))[0] != 0:
                process, status = end
                if process not in reports:
                    continue
                report = reports.pop(process)
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(process, signal.SIGKILL)
                if not reports:
                    end_descendants()
                with suppress(OSError):
                    os.write(report, NUMBER.pack(status))
                os.close(report)

    signal.signal(signal.SIGCHLD, report_ends)
    with socket.socket(fileno=descriptor) as control:
        control.settimeout(ORPHANED)
        while True:
            try:
                request, descriptors, _, _ = socket.recv_fds(control, 1, 4)
            except TimeoutError:
                if os.getppid() != bench:
                    break
                continue
            except ConnectionResetError:
                break
            if not request:
                break
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
            own, process = os.getpid(), os.fork()
            if process == 0:
                control.close()
                for report in reports.values():
                    os.close(report)
                _become_tracker(own, descriptors)
            reports[process], *streams = descriptors
            for stream in streams:
                os.close(stream)
            os.write(reports[process], NUMBER.pack(process))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    end_children(reports, signal.SIGKILL)


def _become_tracker(server: int, descriptors: Sequence[int]) -> NoReturn:
    """Become the process that the bench asks for, in a session of its own."""
    # A group of its own, which a tracker may kill.
    os.setsid()
    end_with_parent(server, signal.SIGKILL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    report, *streams = descriptors
    os.close(report)
    for stream, descriptor in enumerate(streams):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    with open(0, "rb", buffering=0, closefd=False) as requests:
        launch = Launch(**read_message(requests.read))
    if launch.command[: len(HOST)] == HOST:
        with suppress(OSError):
            # It may have been deleted.
            os.chdir(launch.folder)
        sys.path[:] = (launch.python_path or "").split(os.pathsep)
        host.main(launch.command[len(HOST) :])
    # What Python ignores.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
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

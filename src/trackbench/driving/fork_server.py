"""Server process that forks the processes of trackers. It has imported their modules and holds no ground truth.

A fork takes .02 s, a new interpreter .5 s. The server also ends processes that trackers leave behind.
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
from trackbench.driving.descendants import adopt_orphans, end_descendants, end_with_parent
from trackbench.driving.frames import LENGTH, frame_message, message_frame
from trackbench.driving.process import HOST, NUMBER

#: Bytes of a launch request read at once, and period at which the server checks that the bench still runs, s.
LAUNCH_BYTES, ORPHANED = 1 << 16, 2.0


def serve(descriptor: int) -> None:
    """Start a process for each launch request, and report its id and its exit status, until the bench ends.

    Args:
        descriptor: socket of the launch requests. Each brings the descriptors for reports, standard input, standard
            output and, optionally, standard error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    adopt_orphans()
    bench, reports = os.getppid(), dict[int, int]()

    def report_ends(*_: object) -> None:
        with suppress(ChildProcessError):
            while (end := os.waitpid(-1, os.WNOHANG))[0]:
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
    with socket.socket(fileno=descriptor) as control, suppress(ConnectionResetError, BrokenPipeError):
        control.settimeout(ORPHANED)
        while os.getppid() == bench:
            try:
                request, (report, *streams), _, _ = socket.recv_fds(control, LAUNCH_BYTES, 4)
            except TimeoutError:
                continue
            except ValueError:
                # The bench has closed its end of the socket.
                break
            while len(request) < LENGTH.size + LENGTH.unpack_from(request)[0]:
                request += control.recv(LAUNCH_BYTES)
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
            server_process, process = os.getpid(), os.fork()
            if process == 0:
                for other in (control.detach(), report, *reports.values()):
                    os.close(other)
                _become_tracker(server_process, streams, **frame_message(request[LENGTH.size :]))
            reports[process] = report
            for stream in streams:
                os.close(stream)
            os.write(report, NUMBER.pack(process))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    end_descendants()


def _become_tracker(
    server: int, streams: Sequence[int], command: list[str], folder: str, path: list[str], environment: dict[str, str]
) -> NoReturn:
    # A tracker may kill its process group, which must not be the server's.
    os.setsid()
    end_with_parent(server, signal.SIGKILL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for stream, descriptor in enumerate(streams):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    with suppress(OSError):
        # The folder may be gone.
        os.chdir(folder)
    if command[: len(HOST)] == HOST:
        os.environ.clear()
        os.environ.update(environment)
        sys.path[:] = path
        host.serve_tracker(command[len(HOST) :])
    # Python ignores these signals; another program expects their defaults.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execve(command[0], command, environment)
    except (OSError, ValueError) as error:
        os.write(1, message_frame({"type": "error", "message": f"it cannot be started: {error}"}))
        # The bench writes first; without a reader its write would fail and hide the reason.
        os.read(0, 1)
    os._exit(1)

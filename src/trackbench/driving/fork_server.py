"""Server process that forks the processes of trackers. It has imported their modules and holds no ground truth.

A fork takes .02 s, a new interpreter .5 s.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from threading import Thread
from typing import Any, NoReturn

from trackbench.base.exit_status import end_without_reader
from trackbench.driving import host
from trackbench.driving.frames import message_frame
from trackbench.driving.process import HOST, NUMBER


def serve(descriptor: int) -> None:
    """Start a tracker for each launch request, until the bench ends.

    Args:
        descriptor: socket of the launch requests. Each brings the descriptors for reports, standard input, standard
            output and standard error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The system forgets watchers that have ended.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with Connection(descriptor) as control, suppress(EOFError, OSError):
        while True:
            launch = control.recv()
            descriptors = [recv_handle(control) for _ in range(4)]
            if os.fork() == 0:
                control.close()
                _watch(launch, *descriptors)
            for each in descriptors:
                os.close(each)


def _watch(launch: Mapping[str, Any], report: int, *streams: int) -> None:
    """Start a tracker; report its id and exit status; end its process group once the tracker or the bench has ended."""
    try:
        os.setsid()
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        tracker = os.fork()
        if tracker == 0:
            os.close(report)
            _become_tracker(streams, **launch)
        for stream in streams:
            os.close(stream)
        Thread(target=end_without_reader, args=(report,), daemon=True).start()
        os.write(report, NUMBER.pack(tracker))
        os.write(report, NUMBER.pack(os.waitpid(tracker, 0)[1]))
    finally:
        os.killpg(0, signal.SIGKILL)


def _become_tracker(
    streams: tuple[int, ...], command: list[str], folder: str, path: list[str], environment: dict[str, str]
) -> NoReturn:
    for stream, descriptor in enumerate(streams):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    with suppress(OSError):
        # The folder may be gone.
        os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    if command[: len(HOST)] == HOST:
        sys.path[:] = path
        host.serve_tracker(command[len(HOST) :])
    # Python ignores these signals; another program expects their defaults.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(command[0], command)
    except (OSError, ValueError) as error:
        os.write(1, message_frame({"type": "error", "message": f"it cannot be started: {error}"}))
        # The bench writes first; without a reader its write would fail and hide the reason.
        os.read(0, 1)
    os._exit(1)

"""A program in another language in place of the process that its guard has started."""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Sequence
from typing import NoReturn

from trackbench.driving.wire import Launch

#: Exit status of a shell where a program cannot be started.
NOT_STARTED = 126


def become(descriptors: Sequence[int], launch: Launch) -> NoReturn:
    """Replace this process, whose standard error is set, by a program.

    Args:
        descriptors: its standard input and output.
        launch: the program.
    """
    # A group of its own, which it may kill.
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # What Python ignores, and Ctrl-C, which is for the bench.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for stream, descriptor in enumerate(descriptors):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if launch.python_path is not None:
        environment["PYTHONPATH"] = launch.python_path
    assert launch.command is not None
    try:
        os.chdir(launch.folder)
        os.execve(launch.command[0], launch.command, environment)
    except (OSError, ValueError) as error:
        os.write(2, f"{launch.command[0]} cannot be started: {error}\n".encode())
    os._exit(NOT_STARTED)

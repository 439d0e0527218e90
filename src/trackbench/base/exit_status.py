"""Ends of processes, and exit statuses of the command line other than 0 and 1, which the README explains."""

from __future__ import annotations

import os
import select
import signal

BAD_INPUT = 2
#: Status where a tracker, or another plug-in, failed.
FAILED_PLUGIN = 3
CANNOT_WRITE = 4
#: Status of an internal error, or of a command that ended without a status (sysexits.h).
FAULT = 70
#: Statuses that a shell reports of a program ended by Ctrl-C, and of a program whose output nobody reads.
INTERRUPTED, UNREAD = 130, 141


def how_it_ended(code: int) -> str:
    """Return in words how a process ended, from its exit code: minus the signal's number if a signal killed it."""
    if code >= 0:
        return f"its process ended itself, with status {code}"
    names = {number.value: f" ({number.name})" for number in signal.Signals}
    return f"its process was killed by signal {-code}{names.get(-code, '')}"


def end_without_reader(pipe: int) -> None:
    """Wait until nobody can read a pipe any more; then end the process group of this process."""
    unread = select.poll()
    # That is an error, for which no event needs to be asked.
    unread.register(pipe, 0)
    unread.poll()
    os.killpg(0, signal.SIGKILL)

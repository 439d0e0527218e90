"""Parent process that a shell sees: it runs the command in a child, and reports a child that sends no status.

A user's metric or motion model runs in the process of the command and may end it, as by ``os._exit(0)``. Only a status
that the command itself has sent is a result.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Thread
from typing import NoReturn

from trackbench.base.exit_status import FAULT, INTERRUPTED, end_without_reader

#: Options of commands that run no plug-in, or that need no process between them and a debugger.
WITHOUT_PARENT = {"--help", "-h", "--version", "--in-process"}
#: Number of the signal that kills a command; the signals before it ask the command to end.
LAST_SIGNAL = 3
#: Message on an interrupted command.
UNFINISHED = "the unfinished run was not kept"


def is_wanted(arguments: Sequence[str]) -> bool:
    """Return whether a command with these arguments is run in a child process."""
    if not hasattr(os, "fork") or not arguments or not WITHOUT_PARENT.isdisjoint(arguments):
        return False
    traced = sys.gettrace() is not None or (sys.version_info >= (3, 12) and sys.monitoring.get_tool(0) is not None)
    return not traced and not any(name.endswith("_COMPLETE") for name in os.environ)


def run_in_child(command: Callable[[], int]) -> NoReturn:
    """Run a command in a child process, in a process group of its own, and end with its status."""
    receiving, telling = os.pipe()
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.close(receiving)
        Thread(target=end_without_reader, args=(telling,), daemon=True).start()
        status = command()
        os.write(telling, bytes([status]))
        sys.exit(status)
    signals = 0

    def pass_on(*_: object) -> None:
        nonlocal signals
        signals += 1
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL if signals >= LAST_SIGNAL else signal.SIGTERM)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, pass_on)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    os.set_blocking(receiving, False)
    with suppress(BlockingIOError):
        os._exit(os.read(receiving, 1)[0])
    if signals:
        _say(f"interrupted: {UNFINISHED}")
        os._exit(INTERRUPTED)
    cause = f"ended itself, with status {ended}" if ended >= 0 else f"was killed by {signal.Signals(-ended).name}"
    _say(f"trackbench: no result: the process of the command {cause}, perhaps by a plug-in or for lack of memory")
    os._exit(FAULT)


def _say(text: str) -> None:
    with suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)

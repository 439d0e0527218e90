"""What concerns the whole process: its exit status, Ctrl-C, processes that are started, garbage collection."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

T = TypeVar("T")

BAD_INPUT = 2
#: A tracker, or another plug-in, failed.
FAILED_PLUGIN = 3
CANNOT_WRITE = 4
#: Of sysexits.h: an internal error.
FAULT = 70
#: What a shell reports of a program that Ctrl-C ended, and of one whose reader has gone.
INTERRUPTED, UNREAD = 130, 141


def clear_of_streams(descriptor: int) -> int:
    """The same open file under a number that is none of the standard streams', which may be closed."""
    if descriptor > 2 or fcntl is None:
        return descriptor
    clear = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    os.close(descriptor)
    return clear


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """While no other process locks a folder, where the system and the file system have locks."""
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def how_it_ended(code: int) -> str:
    """How a process ended, from its exit code, which is minus the number of the signal that killed it."""
    if code >= 0:
        return f"its process ended itself, with status {code}"
    names = {number.value: f" ({number.name})" for number in signal.Signals}
    return f"its process was killed by signal {-code}{names.get(-code, '')}"


@contextmanager
def uninterrupted() -> Iterator[None]:
    """With Ctrl-C held back, and for good from the processes that start meanwhile: each would print a traceback.

    So is SIGTERM; a process lets it through again by ``allow_termination``.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Where this helper of multiprocessing is not there yet, its start would undo what follows.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def allow_termination() -> None:
    """Let SIGTERM end this process, which was started uninterrupted."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def collect_rarely() -> None:
    """Look after 500,000 new objects, not 700.

    The modules and the figures of a command are some hundred thousand objects that stay; with Python's own number a
    tenth of a short run was spent looking at them.
    """
    gc.set_threshold(500_000, 50, 100)

"""The processes that descend from this one, on Linux. Elsewhere none are known, and these functions do nothing."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

#: prctl(2)
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36


def adopt_orphans() -> None:
    """Become the parent of every descendant whose own parent ends, also of those in sessions of their own."""
    _prctl(PR_SET_CHILD_SUBREAPER, 1)


def end_with_parent(parent: int, number: signal.Signals) -> None:
    """Get a signal when the parent ends, or now if it has.

    Args:
        parent: number of the process that started this one, which has a single thread.
        number: the signal.
    """
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def children(process: int) -> list[int]:
    """The processes that one has started or adopted, those that ended and were not waited for among them."""
    numbers: list[int] = []
    for file in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):
            numbers += map(int, file.read_text().split())
    return numbers


def descendants(process: int) -> Iterator[int]:
    """The children of a process, theirs, and so on."""
    for child in children(process):
        yield child
        yield from descendants(child)


def end_descendants(kept: Collection[int] = ()) -> None:
    """Kill all that descends from this process, which adopts orphans, and wait for it; ``kept``: children to leave."""
    while processes := [child for child in children(os.getpid()) if child not in kept]:
        end_children(processes, signal.SIGKILL)


def end_children(processes: Collection[int], number: signal.Signals) -> None:
    """Send children of this process a signal to end, and wait for them."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, number)
    for process in processes:
        with suppress(ChildProcessError):
            os.waitpid(process, 0)


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        # Imported here: --help need not wait for it.
        import ctypes

        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)

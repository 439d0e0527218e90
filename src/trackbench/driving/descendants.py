"""Processes that descend from another one, on Linux. Elsewhere none are known, and these functions do nothing."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Sequence
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
    """Return the processes that one has started or adopted, also those that ended and were not waited for."""
    numbers: list[int] = []
    # The process may end meanwhile, or one of its threads.
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{process}/task"):
            with suppress(OSError):
                numbers += map(int, Path(f"/proc/{process}/task/{thread}/children").read_text().split())
    return numbers


def descendants(process: int) -> Iterator[int]:
    """Yield the children of a process, their children, and so on."""
    for child in children(process):
        yield child
        yield from descendants(child)


def memory_of(processes: Sequence[int], most: int) -> int:
    """Return the resident memory of processes, bytes; where that is above ``most``, what several share counts once."""
    resident = sum(map(_resident, processes))
    return resident if resident <= most else sum(map(_proportional, processes))


def end_marked(mark: str) -> None:
    """Kill all processes that were started with ``NAME=value`` in their environment."""
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark.encode() in (place / "environ").read_bytes():
                os.kill(int(place.name), signal.SIGKILL)


def end_descendants() -> None:
    """Kill all that descends from this process, which adopts orphans, and wait for it."""
    while processes := children(os.getpid()):
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        for process in processes:
            with suppress(ChildProcessError):
                os.waitpid(process, 0)


def _resident(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


def _proportional(process: int) -> int:
    """Return the resident memory of a process, with its share of what it shares with other processes, bytes."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return _resident(process)
    return next((int(line.split()[1]) * 1024 for line in text.splitlines() if line.startswith("Pss:")), 0)


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        # Imported here: --help need not wait for it.
        import ctypes

        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)

"""Descendants of a process on Linux. On other systems none are found, and these functions do nothing."""

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
    """Make this process the parent of each descendant whose own parent ends, even in sessions of their own."""
    _prctl(PR_SET_CHILD_SUBREAPER, 1)


def end_with_parent(parent: int, number: signal.Signals) -> None:
    """Make this process receive a signal when its parent, which has a single thread, ends; at once if it has ended."""
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def children(process: int) -> list[int]:
    """Return the ids of processes that a process has started or adopted, even ended ones not yet waited for."""
    numbers: list[int] = []
    # The process or one of its threads may end meanwhile.
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{process}/task"):
            with suppress(OSError):
                numbers += map(int, Path(f"/proc/{process}/task/{thread}/children").read_text().split())
    return numbers


def descendants(process: int) -> Iterator[int]:
    """Yield the ids of a process's children, of their children, and so on."""
    for child in children(process):
        yield child
        yield from descendants(child)


def memory_of(processes: Sequence[int], most: int) -> int:
    """Return the resident memory of processes, bytes; if more than ``most``, without counting shared memory twice."""
    resident = sum(map(_resident_memory, processes))
    return resident if resident <= most else sum(map(_proportional_memory, processes))


def end_marked(mark: str) -> None:
    """Kill all processes that have ``mark``, such as ``NAME=value``, in their environment."""
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark.encode() in (place / "environ").read_bytes():
                os.kill(int(place.name), signal.SIGKILL)


def end_descendants() -> None:
    """Kill all descendants of this process, which adopts orphans, and wait for them."""
    while processes := children(os.getpid()):
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        for process in processes:
            with suppress(ChildProcessError):
                os.waitpid(process, 0)


def _resident_memory(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0


def _proportional_memory(process: int) -> int:
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return _resident_memory(process)
    return next((int(line.split()[1]) * 1024 for line in text.splitlines() if line.startswith("Pss:")), 0)


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        # Imported late, so that --help is fast.
        import ctypes

        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)

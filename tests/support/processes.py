"""Processes below another one, on Linux."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


def children(process: int) -> list[int]:
    """Return the ids of processes that a process has started, even ended ones not yet waited for."""
    numbers: list[int] = []
    # The process or one of its threads may end meanwhile.
    with suppress(OSError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            with suppress(OSError):
                numbers += map(int, (thread / "children").read_text().split())
    return numbers


def descendants(process: int) -> Iterator[int]:
    """Yield the ids of a process's children, of their children, and so on."""
    for child in children(process):
        yield child
        yield from descendants(child)

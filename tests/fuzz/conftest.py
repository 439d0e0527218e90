"""A command as a user sees it: its status, and no traceback."""

from __future__ import annotations

import faulthandler
import resource
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

Tried = Callable[..., int]
#: What a command may take: s, and bytes of address space.
TIME, MEMORY = 300, 8 * 2**30


@pytest.fixture
def tried(cli: Callable[..., Any]) -> Iterator[Tried]:
    """Runs a command, which must end with one of ``statuses``, without a traceback, and say why if with 2.

    The faults of all cases are shown together, at the end; a command that takes too long ends the tests.
    """
    faults: list[str] = []

    def call(case: int, *arguments: str | Path, statuses: tuple[int, ...] = (0, 2)) -> int:
        faulthandler.dump_traceback_later(TIME, exit=True)
        done = cli(*arguments)
        faulthandler.cancel_dump_traceback_later()
        right = done.status in statuses and not any(word in done.err for word in ("Traceback", "memory is not enough"))
        explained = done.status != 2 or 0 < len(done.err) < 20_000
        if not (right and explained):
            faults.append(f"case {case}: {' '.join(map(str, arguments))}: status {done.status}\n{done.err[-1500:]}")
        return int(done.status)

    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, before[1]))
    yield call
    resource.setrlimit(resource.RLIMIT_AS, before)
    assert not faults, f"{len(faults)} faults\n" + "\n".join(faults)

"""Memory that stays with the process between the steps of a filter."""

from __future__ import annotations

from functools import cache

import numpy as np

#: Just below 32 MiB, the largest block that teaches glibc anything, in numbers of eight bytes.
TEACHING_SIZE = 4_000_000


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed arrays for the next step, where it would return them to the system.

    At first glibc maps every block of more than 128 KiB from the system and unmaps it again, so that each step of a
    filter waits for fresh pages: a fifth of the time of an extended Kalman filter. It raises that limit to the size of
    any such block that is freed (mallopt(3), M_MMAP_THRESHOLD). This one is never touched, so it costs no memory; other
    C libraries are not affected.
    """
    np.empty(TEACHING_SIZE)

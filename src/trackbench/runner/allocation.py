"""Memory that stays with the process between the steps of a filter."""

from __future__ import annotations

import ctypes
from functools import cache

#: Parameters of mallopt(3), from malloc.h.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
#: The largest that glibc takes, bytes.
LARGEST = 32 * 2**20


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed arrays for the next step, where it would return them to the system.

    At first glibc maps every block of more than 128 KiB from the system and unmaps it again, so that each step of a
    filter waits for fresh pages: a fifth of the time of an extended Kalman filter, and three quarters in a Dask worker,
    whose environment fixes the limits low. Other C libraries are not affected.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, 2 * LARGEST)

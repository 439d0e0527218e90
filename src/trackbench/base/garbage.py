"""Python's garbage collection, in a command and in its workers."""

from __future__ import annotations

import gc


def collect_rarely() -> None:
    """Look for garbage after 500,000 new objects, not 700.

    The modules and figures of a command are some hundred thousand objects that stay: to look at them took a tenth of a
    short run.
    """
    gc.set_threshold(500_000, 50, 100)

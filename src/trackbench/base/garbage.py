"""How often a process of trackbench looks for garbage."""

from __future__ import annotations

import gc


def collect_rarely() -> None:
    """Look after 100,000 new objects, not 700.

    The modules and the figures of a command are some hundred thousand objects that stay; with Python's own number a
    tenth of a short run was spent looking at them.
    """
    gc.set_threshold(100_000, 50, 100)

"""Which trackers the fused engine left to NumPy, and what is wrong with a user's model."""

from __future__ import annotations

import logging

from trackbench.base.errors import counted
from trackbench.engine.equations import EngineUsed

log = logging.getLogger(__name__)


def log_left_to_numpy(where: str, name: str, used: EngineUsed) -> None:
    """Say of a tracker that the fused engine left it to NumPy, and why."""
    if used.why_numpy:
        how = "computed by NumPy" if used.engine == "numpy" else "computed by NumPy in part"
        # Of a user's own model it is said without --verbose.
        level = logging.WARNING if used.of_user else logging.INFO
        log.log(level, "%s: %s was %s: %s", where, name, how, used.why_numpy)
    if used.again:
        members = counted(used.again, "member")
        log.info("%s: %s: %s of batches computed again by NumPy, where the trace did not hold", where, name, members)

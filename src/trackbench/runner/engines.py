"""Which engine computed the trackers of a run, and which of them it left to NumPy."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.engine.equations import ComputedBy, EngineUsed, joined
from trackbench.runner.block import Block
from trackbench.runner.work import Work

log = logging.getLogger(__name__)


def engines_of(work: Work, blocks: Sequence[Block]) -> dict[str, EngineUsed]:
    """By built-in tracker, what computed all its blocks."""
    parts = {name: [block.engines[name] for block in blocks if name in block.engines] for name in work.trackers}
    return {name: used for name, each in parts.items() if (used := joined(each)) is not None}


def engine_of_all(work: Work, used: Mapping[str, EngineUsed]) -> ComputedBy:
    """What computed the built-in trackers together; without any, what computed the scores."""
    together = joined(used.values())
    return work.engine if together is None else together.engine


def log_left_to_numpy(where: str, name: str, used: EngineUsed) -> None:
    """Say of a tracker that the fused engine left it to NumPy, and why."""
    if used.why_numpy:
        how = "computed by NumPy" if used.engine == "numpy" else "computed by NumPy in part"
        log.info("%s: %s was %s: %s", where, name, how, used.why_numpy)
    if used.again:
        members = counted(used.again, "member")
        log.info("%s: %s: %s of batches computed again by NumPy, where the trace did not hold", where, name, members)

"""Which engine computed a tracker, and why it was not the one that was asked for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

ComputedBy = Literal["numpy", "fused", "fused and numpy"]


class EngineUsed(NamedTuple):
    """What computed the steps of a built-in tracker."""

    engine: ComputedBy
    why_numpy: str = ""
    """Why the fused engine left some or all of them to NumPy; empty where it did not, or was not asked."""
    again: int = 0
    """How many members of batches NumPy computed again, of which the trace did not hold."""


def joined(parts: Iterable[EngineUsed]) -> EngineUsed | None:
    """What computed all parts together; None where there are none."""
    known = list(parts)
    if not known:
        return None
    engines = {part.engine for part in known}
    reasons = dict.fromkeys(part.why_numpy for part in known if part.why_numpy)
    engine = engines.pop() if len(engines) == 1 else "fused and numpy"
    return EngineUsed(engine, "; ".join(reasons), sum(part.again for part in known))

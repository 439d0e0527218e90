"""A prediction and an update of a filter as one step."""

from __future__ import annotations

from typing import Any

from trackbench.base.types import Scan
from trackbench.engine.filters import FusedFilter
from trackbench.filters import Step


def step_of(filter: Any, belief: Any, dt: float, scan: Scan) -> Step[Any]:
    """By one kernel of a fused filter; by NumPy a prediction and an update."""
    if isinstance(filter, FusedFilter):
        return filter.step(belief, dt, scan)
    update = filter.update(filter.predict(belief, dt), scan)
    return Step(update, filter.cartesian(update.belief))

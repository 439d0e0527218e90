"""What a tracker is. Nothing here needs to be imported by a tracker of the user's own."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from trackbench.base.types import Array, Estimate, Scan
from trackbench.filters import AnyBelief


class Tracker(Protocol):
    """Estimates one object (or, with a class attribute ``batched = True``, a batch of them) from its measurements.

    One that draws random numbers, such as a particle filter, says so by a class attribute ``stochastic = True``.
    """

    def step(self, state: Any, scan: Scan) -> tuple[Any, Estimate | tuple[Array, Array] | None]:
        """The state and the estimate after a scan.

        ``state`` is None at the first measurement and is never changed in place. The estimate is None while there is
        none; a batched tracker gives NaN where an object has none yet.
        """
        ...


class Prior(NamedTuple):
    """Where each track starts, for a tracker that is given its first state rather than finding it."""

    time: Array
    """``(...)`` s."""
    belief: AnyBelief
    """Its mean drawn from the truth, with the covariance of the draw."""

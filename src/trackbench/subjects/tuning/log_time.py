"""The time of a log cut into stretches: those that are tuned on, and those that are held out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.sums import SHORTEST, STRETCHES, stretches

#: Shortest time at the beginning of a stretch that counts neither for tuning nor for trying, s.
GAP = 1.0


class LogTime(NamedTuple):
    """Which stretches of time of a single run are scored, each by itself.

    Held-out stretches alternate with those that are tuned on, so that both have whatever the log has at all times.
    """

    gap: float
    """At the beginning of each stretch, s: as long as a track needs to settle."""
    held_out: bool | None = None
    """Whether it is the stretches that are held out, or those that are tuned on; None: the whole log."""

    @property
    def shortest(self) -> float:
        """Duration of a log of which something can be held out, s."""
        return 2 * (SHORTEST + self.gap)

    def stretch(self, time: Array) -> Indices:
        """``(instants,)`` number of the stretch of each, -1 where it does not count.

        Args:
            time: ``(instants,)`` s.
        """
        duration = float(time[-1] - time[0])
        if self.held_out is None:
            return stretches(len(time), duration)
        count = min(2 * STRETCHES, int(duration / (SHORTEST + self.gap)))
        place = (time - time[0]) / duration * count
        number = np.minimum(place.astype(np.intp), count - 1)
        scored = (number % 2 == int(self.held_out)) & ((place - number) * duration / count >= self.gap)
        return np.where(scored, number // 2, -1)

"""The forward collision warning, by the time to collision."""

from __future__ import annotations

from pydantic import Field

from trackbench.base.config import Positive
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import on_path, probability_positive, time_until
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision


class ForwardCollisionWarning(Function):
    """Warns of an object in the path of the ego whose time to collision is too short.

    With the gap d and the closing speed v the condition is d - v t < 0, for an object ahead that overlaps the path in
    width. Its probability is Phi((v t - d) / sigma) times the probability of the overlap: errors along and across the
    path are assumed to be independent. It is exact on a straight path, since the margin is linear.

    Source: ISO 15623 (forward vehicle collision warning systems); NHTSA (2013), "Forward Collision Warning System
    Confirmation Test", which states when a warning has to come as a time to collision.
    """

    quantity = Quantity("ttc", "s", "time to collision")

    ttc_s: Positive = Field(2.4, description="Time to collision below which it warns, s.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        positions = on_path(ego, objects)
        closing, gap, within = ego.speed - positions.speed, positions.gap, positions.probability_within()
        too_short = probability_positive(closing * self.ttc_s - gap, positions.variance((-1.0, 0.0, -self.ttc_s, 0.0)))
        ahead = objects.there & (positions.along > 0)
        ttc = time_until(gap, closing)
        possible = ahead & (within > 0.5) & (closing > 0)
        return decision(possible, ahead * within * too_short, self.probability, ttc, ttc)

"""The following distance: the choice of the lead, and its headway."""

from __future__ import annotations

from pydantic import Field

from trackbench.base.config import Positive
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import on_path, probability_positive, time_until
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision


class FollowingDistance(Function):
    """Chooses the lead, the nearest object ahead in the path of the ego, and is active where it is too near.

    The headway is the gap over the ego's speed: the time until the ego reaches the lead's present rear. An object is in
    the path where it overlaps the path in width with more than the probability. An object beyond the range is no lead,
    since no sensor need see it. The condition is d - v t < 0 with the gap d and the ego's speed v. Its probability is
    exact on a straight path, and is multiplied by the probability of the overlap.

    Source: ISO 15622 (adaptive cruise control systems): the time gap is 0.8 s or more.
    """

    quantity = Quantity("headway", "s", "headway")
    chooses_lead = True

    headway_s: Positive = Field(0.8, description="Headway below which it is active, s.")

    range_m: Positive = Field(150.0, description="Largest gap to a lead, m.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        positions = on_path(ego, objects)
        gap, within = positions.gap, positions.probability_within()
        too_near = probability_positive(ego.speed * self.headway_s - gap, positions.variance((-1.0, 0.0, 0.0, 0.0)))
        ahead = objects.there & (positions.along > 0) & (gap <= self.range_m)
        possible = ahead & (within > self.probability)
        headway = time_until(gap, ego.speed)
        return decision(possible, ahead * within * too_near, self.probability, gap, headway)

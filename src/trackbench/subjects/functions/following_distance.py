"""Following distance: which vehicle is the lead, and how far it is ahead in time."""

from __future__ import annotations

from pydantic import Field

from trackbench.base.config import Positive
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import on_path, probability_positive, time_until
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision


class FollowingDistance(Function):
    """Chooses the lead, the nearest object ahead in the path of the ego, and is active where it is too near.

    The headway is the gap over the speed of the ego: the time until it is where the lead's rear is now. An object is in
    the path where it overlaps it in width with more than the probability. One that is farther than the range is no
    lead: no sensor need see it. The condition is d - v t < 0 with the gap d
    and the ego's speed v; its probability is exact on a straight path, times that of the overlap.

    Source: ISO 15622 (adaptive cruise control systems): the time gap is 0.8 s or more.
    """

    quantity = Quantity("headway", "s", "headway")
    chooses_lead = True

    headway_s: Positive = Field(0.8, description="It is active where the headway is shorter, s.")

    range_m: Positive = Field(150.0, description="A gap up to which an object can be the lead, m.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        place = on_path(ego, objects)
        gap, within = place.gap, place.probability_within()
        too_near = probability_positive(ego.speed * self.headway_s - gap, place.variance((-1.0, 0.0, 0.0, 0.0)))
        ahead = objects.there & (place.along > 0) & (gap <= self.range_m)
        possible = ahead & (within > self.probability)
        headway = time_until(gap, ego.speed)
        return decision(possible, ahead * within * too_near, self.probability, gap, headway)

"""The lane change function, for a car behind in the next lane that is too near."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import NonNegative, Positive
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.emergency_braking import required_deceleration
from trackbench.subjects.functions.path import on_path, probability_positive
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision

#: Distance from the middle of the ego's lane to that of the next one, m.
LANE_WIDTH_M = 3.5
#: Time before the car behind brakes, t_b in the source, s.
REACTION_S = 0.4


class LaneChange(Function):
    """Prevents a lane change while a car behind or beside in the next lane would have to brake too hard.

    A lane change is critical where a car behind approaches and its gap d is below v t_g + c t_b + c^2 / (2 a). The
    terms are the ego's speed v times the remaining time gap, the way of the closing speed c > 0 before the car brakes,
    and its way while the car brakes at a. A car beside the ego is critical at any speed. The car must overlap in width
    with the ego's path, moved by one lane. The probability is the overlap's times the larger one of both cases. For a
    car behind it is the smaller one of two: of the margin, to first order, and of c > 0.

    Source: UN Regulation No. 79, paragraph 5.6.4.7: a = 3 m/s^2, t_b = 0.4 s, t_g = 1 s.
    """

    quantity = Quantity("deceleration", "m/s^2", "deceleration that is required of the car behind")

    side: Literal["left", "right"] = Field("left", description="Side of the next lane.")
    deceleration_mps2: Positive = Field(
        3.0, description="Largest deceleration that may be required of the car behind, m/s^2."
    )
    headway_s: NonNegative = Field(1.0, description="Time gap that must remain between the two, s.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        positions = on_path(ego, objects)
        within = positions.probability_within(LANE_WIDTH_M if self.side == "left" else -LANE_WIDTH_M)
        closing, gap = np.maximum(positions.speed - ego.speed, 0.0), -positions.along - positions.lengths
        braking_way = gap - ego.speed * self.headway_s - closing * REACTION_S
        margin = closing**2 / (2.0 * self.deceleration_mps2) - braking_way
        approaches = closing > 0
        by_speed = approaches * (REACTION_S + closing / self.deceleration_mps2)
        too_near = probability_positive(margin, positions.variance((1.0, 0.0, by_speed, 0.0)))
        closes = probability_positive(positions.speed - ego.speed, positions.variance((0.0, 0.0, 1.0, 0.0)))
        beside = probability_positive(-gap, positions.variance((1.0, 0.0, 0.0, 0.0)))
        critical = np.maximum(beside, np.minimum(too_near, closes))
        behind = objects.there & (positions.along < positions.lengths)
        required = np.where(gap > 0, required_deceleration(closing, braking_way), np.nan)
        return decision(behind & (within > 0.5), behind * within * critical, self.probability, -margin, required)

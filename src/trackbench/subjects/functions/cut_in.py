"""The cut-in function, for an object beside the path that will soon be in it."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from trackbench.base.config import NonNegative
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import on_path, probability_positive, time_until
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision

#: Time for which the motion of the other vehicle is predicted, s.
HORIZON_S = 1.0


class CutIn(Function):
    """Warns of an object ahead and beside the path of the ego that will soon be in the path, and too near.

    The lateral position of an object that does not overlap the path now is predicted with its lateral speed y':
    y + y' h after the horizon h = 1 s. A gap is too near below the larger of two lengths: the ego's speed times a
    headway, and the closing speed times a time to collision. The probability is the product of two: of an overlap
    after the horizon, and of too near a gap. Both are exact on a straight path.

    UN Regulation No. 157, paragraph 5.2.5.2, judges a cut-in by the time to collision when the vehicle intrudes; the
    prediction and the defaults are this project's.
    """

    quantity = Quantity("entry", "s", "time until it is in the path")

    headway_s: NonNegative = Field(1.0, description="A shorter time gap at the ego's speed is too near, s.")
    ttc_s: NonNegative = Field(3.0, description="A shorter time to collision is too near, s.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        positions = on_path(ego, objects)
        by_headway, by_time = self.headway_s * ego.speed, self.ttc_s * (ego.speed - positions.speed)
        by_speed = np.where(by_time > by_headway, -self.ttc_s, 0.0)
        margin = np.maximum(by_headway, by_time) - positions.gap
        too_near = probability_positive(margin, positions.variance((-1.0, 0.0, by_speed, 0.0)))
        beside = objects.there & (positions.along > 0) & (positions.probability_within() <= 0.5)
        entry = time_until(
            np.abs(positions.across) - positions.widths, -np.sign(positions.across) * positions.lateral_speed
        )
        coming = positions.probability_within(after=HORIZON_S)
        return decision(beside & (coming > 0.5), beside * coming * too_near, self.probability, entry, entry)

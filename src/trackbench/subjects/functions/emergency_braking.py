"""The emergency braking, by the deceleration that avoids a collision."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.types import Array
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.path import on_path, probability_positive
from trackbench.subjects.functions.protocol import Decision, Function, Objects, Quantity, decision

#: Largest required deceleration that is stated, m/s^2: tyres give about the acceleration of gravity at most.
LARGEST = 9.81


class EmergencyBraking(Function):
    """Brakes for an object in the path of the ego if its avoidance requires more than a certain deceleration.

    The required deceleration of the relative motion is v^2 / (2 d) with the gap d and the closing speed v, as if the
    object kept its velocity. The condition is v |v| - 2 a d > 0, for an object ahead that overlaps the path in width.
    Its probability is the margin's, to first order, times the overlap's. While active, it commands the required
    deceleration.

    Source: Jansson (2005), "Collision Avoidance Theory", section 5.2; Stellet et al. (2016), "Analytical derivation of
    performance bounds of autonomous emergency brake systems": a threshold of 6 m/s^2.
    """

    quantity = Quantity("deceleration", "m/s^2", "required deceleration")
    brakes = True

    deceleration_mps2: Positive = Field(6.0, description="Required deceleration above which it brakes, m/s^2.")

    def decide(self, ego: Ego, objects: Objects) -> Decision:
        positions = on_path(ego, objects)
        closing, gap, within = ego.speed - positions.speed, positions.gap, positions.probability_within()
        margin = closing * np.abs(closing) - 2.0 * self.deceleration_mps2 * gap
        variance = positions.variance((-2.0 * self.deceleration_mps2, 0.0, -2.0 * np.abs(closing), 0.0))
        ahead = objects.there & (positions.along > 0)
        required = required_deceleration(closing, gap)
        probability = ahead * within * probability_positive(margin, variance)
        return decision(ahead & (within > 0.5) & (closing > 0), probability, self.probability, -required, required)


def required_deceleration(closing: Array, distance: Array) -> Array:
    """Return the deceleration, m/s^2 ``(...)``, that removes a closing speed over a distance; at most ``LARGEST``."""
    square, room = np.maximum(closing, 0.0) ** 2, np.maximum(2.0 * distance, 0.0)
    enough = square < LARGEST * room
    return np.where(enough, square / np.where(enough, room, 1.0), np.where(square > 0, LARGEST, 0.0))

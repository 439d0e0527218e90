"""The velocity at an instant, of bodies that a simulator moves by steps of constant velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackbench.base.types import Array, Mask, Truth
from trackbench.base.units import wrap_angle


def at_instants(truth: Truth, stepped: Mask) -> Truth:
    """The truth with the rates that hold at its instants, where those of the step that begins there are stated.

    A body that moves with one velocity until the next instant has that velocity half a step later, on the smooth path
    through its positions. At the instant it has the mean of the steps before and after, to second order in the step.
    Else the range rate and the velocity would be ahead of the position: by 0.3 m/s at 12 m/s^2 and 20 Hz.

    Args:
        truth: velocity, acceleration and yaw rate are those of the step that begins at each instant.
        stepped: ``(objects,)`` the bodies that move so; the others stay. The observer moves so.
    """
    known = np.zeros_like(truth.alive)
    known[1:] = truth.alive[1:] & truth.alive[:-1]
    known = (known & stepped)[..., None]

    def middle(values: Array) -> Array:
        return np.where(known, 0.5 * (values + _before(values)), values)

    vx, vy = middle(truth.vx), middle(truth.vy)
    moves = known & (np.hypot(vx, vy) > 0.0)
    carrier = truth.observer
    vx_of_carrier, vy_of_carrier, turning = (
        0.5 * (rate + _before(rate)) for rate in (carrier.vx, carrier.vy, carrier.yaw_rate)
    )
    return replace(
        truth,
        speed=np.where(known, np.hypot(vx, vy), truth.speed),
        course=np.where(moves, wrap_angle(np.arctan2(vy, vx)), truth.course),
        # The change from the step before to the step after is that at the instant.
        acceleration=np.where(known, _before(truth.acceleration), truth.acceleration),
        yaw_rate=middle(truth.yaw_rate),
        observer=replace(carrier, vx=vx_of_carrier, vy=vy_of_carrier, yaw_rate=turning),
    )


def _before(values: Array) -> Array:
    """Those of one step before; the first has none and keeps its own."""
    return np.concatenate([values[:1], values[:-1]])

"""What carries the sensors where that is no simulated vehicle."""

from __future__ import annotations

from pydantic import Field

from trackbench.base.config import Angle, Config
from trackbench.truth.limits import Position, Velocity


class FixedObserver(Config):
    """A point beside the road that carries the sensors.

    The fixed frame is highway-env's with its y turned up, so that angles count counter-clockwise from above.
    """

    x: Position = Field(0, description="Position along x in the fixed frame, m.")
    y: Position = Field(0, description="Position along y in the fixed frame, m.")
    yaw_deg: Angle = Field(0, description="Heading in the fixed frame, counter-clockwise from x, degrees.")


class MovingObserver(FixedObserver):
    """A point that carries the sensors, at rest or in straight and steady motion, which may turn as it goes."""

    vx_mps: Velocity = Field(0, description="Velocity along x in the fixed frame, m/s.")
    vy_mps: Velocity = Field(0, description="Velocity along y in the fixed frame, m/s.")
    turn_rate_degps: float = Field(
        0, ge=-720, le=720, description="Rate of change of the heading, counter-clockwise, degrees per second."
    )

"""Effects that move the measured point on a body."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import NonNegative, Positive
from trackbench.base.streams import RunStreams
from trackbench.models.sensors.effects.base import Effect, Sensed
from trackbench.models.sensors.effects.processes import gauss_markov


class Reflection(Effect):
    """Reflection point of a radar, which wanders about the line from the box's centre to its nearest point.

    The range rate is that of the point, with the velocity that a turn of the body gives it.
    """

    one_of: ClassVar[tuple[str, ...]] = ("toward_sensor", "along_m", "across_m")

    toward_sensor: float = Field(
        0,
        ge=0,
        le=1,
        description="Share of the way from the centre of the vehicle's box (0) to its point nearest to the sensor (1); "
        "less than 1 where the sensor corrects for the size of a car.",
    )
    along_m: NonNegative = Field(0, description="Standard deviation of the wandering along the vehicle, m.")
    across_m: NonNegative = Field(0, description="Standard deviation of the wandering across the vehicle, m.")
    time_s: Positive = Field(1, description="Time constant of the wandering (Gauss-Markov), s.")

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        bodies = sensed.bodies
        half = np.stack([bodies.length, bodies.width])[:, None] / 2
        nearest = np.clip(bodies.seen_from(sensed.pose), -half, half)
        instants, objects = sensed.shape
        white = random.standard_normal((instants, 2, objects))
        wander = np.moveaxis(gauss_markov(sensed.time, self.time_s, white), 1, 0)
        sigmas = np.array([self.along_m, self.across_m])[:, None, None, None]
        ahead, left = self.toward_sensor * nearest + wander * sigmas
        return sensed.replaced(bodies=bodies.moved(ahead, left))


class Faces(Effect):
    """Mean point of a lidar on the faces of a box that it sees, weighted by apparent width."""

    share: float = Field(
        1,
        gt=0,
        le=1,
        description="Share of the way from the centre of the box to the mean point; less than 1 where the sensor "
        "corrects for the size of a car.",
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        bodies = sensed.bodies
        half = np.stack(np.broadcast_arrays(bodies.length / 2, bodies.width / 2))[:, None]
        sensor = bodies.seen_from(sensed.pose)
        beyond = np.abs(sensor) > half
        # A face of half width w, seen from an offset d beyond it at range r, looks about 2 w d / r wide.
        wide = np.where(beyond, half[::-1] * np.abs(sensor), 0.0)
        total = wide.sum(axis=0)
        weight = np.divide(wide, total, out=np.zeros_like(wide), where=total > 0)
        ahead, left = self.share * weight * half * np.sign(sensor)
        return sensed.replaced(bodies=bodies.moved(ahead, left))

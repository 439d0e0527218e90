"""Multipath: a vehicle that is also seen in a mirror."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive, Problem
from trackbench.base.distributions import normal_quantile
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices
from trackbench.base.units import wrap_angle
from trackbench.models.sensors.effects.base import Effect, Sensed, gauss_markov

#: Nearer than this a wall would be in the body of the observer, m.
NEAREST_WALL_M = 0.5


class Ghosts(Effect):
    """Mirror images of vehicles in a wall or guard rail along the road, on the side of it where no vehicle is.

    The path goes by the wall both ways, so that range, azimuth and range rate are those of the mirror image, which
    follows its cause. The wall stays beside the observer and turns with it, so that the range rate is the derivative of
    the range. With known identities a measurement is never a ghost.
    """

    wall_m: float = Field(
        ge=-1000,
        le=1000,
        description="The wall's distance to the left of the sensor, 0.5 m at the least, parallel to the observer's "
        "heading, m; negative: to the right.",
    )
    probability: float = Field(
        gt=0, lt=1, description="Share of the instants at which a vehicle that the sensor sees has an image."
    )
    time_s: Positive = Field(1, description="Time constant with which images come and go, s.")

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array]:
        presence = gauss_markov(sensed.time, self.time_s, random.standard_normal(sensed.shape))
        sensor, turn = sensed.sensor, sensed.yaw_rate[:, None]
        pose, velocity = sensed.pose[:, :, None], sensed.velocity[:, :, None]
        (x, y, yaw), (ux, uy), mount = pose, velocity, np.deg2rad(sensor.mount.yaw_deg)
        c, s = np.cos(yaw - mount), np.sin(yaw - mount)
        px, py, vx, vy = sensed.bodies.target
        ahead = c * (px - x) + s * (py - y)
        # How far the wall is beyond the vehicle, and the derivative: the normal of the wall turns too.
        beyond = self.wall_m - (c * (py - y) - s * (px - x))
        rate = turn * ahead - (c * (vy - uy) - s * (vx - ux))
        across, along = c * rate - s * turn * beyond, s * rate + c * turn * beyond
        image = np.stack([px - 2.0 * s * beyond, py + 2.0 * c * beyond, vx - 2.0 * along, vy + 2.0 * across])
        mirrored = sensor.measure(image, pose, velocity)
        azimuth = wrap_angle(np.arctan2(self.wall_m + beyond, ahead) - mount)
        in_view = np.abs(azimuth) <= np.deg2rad(sensor.fov_deg) / 2
        if sensor.max_range_m is not None:
            in_view &= np.hypot(ahead, self.wall_m + beyond) <= sensor.max_range_m
        same_side = beyond * np.sign(self.wall_m) > 0
        seen = sensed.visible & same_side & in_view & (presence < normal_quantile(self.probability))
        instant, number, run = np.nonzero(seen)
        return run, instant, np.broadcast_to(mirrored, (len(mirrored), *seen.shape))[:, instant, number, run]

    def problems(self) -> Iterator[Problem]:
        if abs(self.wall_m) < NEAREST_WALL_M:
            sides = f"{NEAREST_WALL_M:g} or more to the left, {-NEAREST_WALL_M:g} or less to the right"
            yield Problem(("wall_m",), f"{self.wall_m:g} is too near to the sensor: {sides}")

"""Multipath: a vehicle that is also seen in a mirror."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.distributions import normal_quantile
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices, Mask
from trackbench.base.units import wrap_angle
from trackbench.models.sensors.effects.base import Effect, Sensed, gauss_markov


class Ghosts(Effect):
    """Mirror images of vehicles in a wall or guard rail along the road, on the side of it where no vehicle is.

    The path goes by the wall both ways, so that range, azimuth and range rate are those of the mirror image, which
    follows its cause. With known identities a measurement is never a ghost.
    """

    wall_m: float = Field(
        ge=-1000, le=1000, description="The wall's distance to the left of the sensor, parallel to its boresight, m."
    )
    probability: float = Field(
        gt=0, lt=1, description="Share of the instants at which a vehicle that the sensor sees has an image."
    )
    time_s: Positive = Field(1, description="Time constant with which images come and go, s.")

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array]:
        presence = gauss_markov(sensed.time, self.time_s, random.standard_normal(sensed.shape))
        x, y, yaw = sensed.pose
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        px, py, vx, vy = sensed.bodies.target
        beyond = self.wall_m - (c * (py - y[:, None]) - s * (px - x[:, None]))
        across = c * vy - s * vx
        image = np.stack([px - 2.0 * s * beyond, py + 2.0 * c * beyond, vx + 2.0 * s * across, vy - 2.0 * c * across])
        sensor = sensed.sensor
        mirrored = sensor.measure(image, sensed.pose[:, :, None], sensed.velocity[:, :, None])
        same_side = beyond * np.sign(self.wall_m) > 0
        seen = sensed.visible & same_side & (presence < normal_quantile(self.probability))
        instant, number, run = np.nonzero(seen & _in_view(sensed, image))
        return run, instant, np.broadcast_to(mirrored, (len(mirrored), *seen.shape))[:, instant, number, run]


def _in_view(sensed: Sensed, image: Array) -> Mask:
    """``(instants, objects, runs or 1)`` whether a point is in the sensor's range and field of view."""
    dx, dy = image[:2] - sensed.pose[:2, :, None]
    azimuth = wrap_angle(np.arctan2(dy, dx) - sensed.pose[2][:, None])
    sensor = sensed.sensor
    farthest = np.inf if sensor.max_range_m is None else sensor.max_range_m
    return np.asarray((np.abs(azimuth) <= np.deg2rad(sensor.fov_deg) / 2) & (np.hypot(dx, dy) <= farthest))

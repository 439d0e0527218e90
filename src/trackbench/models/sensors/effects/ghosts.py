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
        sensor, turn = sensed.sensor, 1j * sensed.yaw_rate[:, None]
        (x, y, yaw), (ux, uy) = sensed.pose[:, :, None], sensed.velocity[:, :, None]
        mount = np.deg2rad(sensor.mount.yaw_deg)
        # Ahead of the sensor and, imaginary, to the left of it, along the observer's heading.
        axis = np.exp(1j * (yaw - mount))
        px, py, vx, vy = sensed.bodies.target
        place = (px - x + 1j * (py - y)) / axis
        change = (vx - ux + 1j * (vy - uy)) / axis - turn * place
        image = np.conj(place) + 2j * self.wall_m
        at, velocity = image * axis, (np.conj(change) + turn * image) * axis
        target = np.stack([at.real + x, at.imag + y, velocity.real + ux, velocity.imag + uy])
        mirrored = sensor.measure(target, sensed.pose[:, :, None], sensed.velocity[:, :, None])
        same_side = (self.wall_m - place.imag) * np.sign(self.wall_m) > 0
        in_view = np.abs(wrap_angle(np.angle(image) - mount)) <= np.deg2rad(sensor.fov_deg) / 2
        if sensor.max_range_m is not None:
            in_view &= np.abs(image) <= sensor.max_range_m
        seen = sensed.visible & same_side & in_view & (presence < normal_quantile(self.probability))
        instant, number, run = np.nonzero(seen)
        return run, instant, np.broadcast_to(mirrored, (len(mirrored), *seen.shape))[:, instant, number, run]

    def problems(self) -> Iterator[Problem]:
        if abs(self.wall_m) < NEAREST_WALL_M:
            sides = f"{NEAREST_WALL_M:g} or more to the left, {-NEAREST_WALL_M:g} or less to the right"
            yield Problem(("wall_m",), f"{self.wall_m:g} is too near to the sensor: {sides}")

"""Multipath: mirror images of vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from pydantic import Field
from scipy.special import ndtri

from trackbench.base.config import Positive, Problem
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices, Mask
from trackbench.base.units import wrap_angle
from trackbench.models.sensors.detection import Point
from trackbench.models.sensors.effects.base import Effect, Sensed
from trackbench.models.sensors.effects.processes import gauss_markov


class Ghosts(Effect):
    """Mirror images of vehicles in walls or guard rails beside the road.

    The signal goes by the wall both ways, so an image has the range, azimuth and range rate of the mirrored vehicle.
    There is an image where sensor and vehicle are on one side of the wall's line, and the path meets the line between
    its ends. With known identities a measurement is never a ghost.
    """

    wall: list[Point] = Field(
        min_length=2,
        description="Corners [x, y] of the wall in the frame of the world, m; it does not move with the observer.",
    )
    probability: float = Field(
        gt=0, lt=1, description="Share of the instants at which a visible vehicle has an image in a wall."
    )
    time_s: Positive = Field(1, description="Time constant with which images come and go, s.")

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array]:
        presence = gauss_markov(sensed.time, self.time_s, random.standard_normal(sensed.shape))
        is_reflected = sensed.visible & (presence < ndtri(self.probability))
        images = [_images(sensed, np.array(start), np.array(end)) for start, end in pairwise(self.wall)]
        parts = []
        for measurement, seen in images:
            instant, number, run = np.nonzero(is_reflected & seen)
            full = np.broadcast_to(measurement, (len(measurement), *is_reflected.shape))
            parts.append((run, instant, full[:, instant, number, run]))
        runs, instants, measurements = zip(*parts, strict=True)
        return np.concatenate(runs), np.concatenate(instants), np.concatenate(measurements, axis=1)

    def problems(self) -> Iterator[Problem]:
        for i, (start, end) in enumerate(pairwise(self.wall)):
            if start == end:
                yield Problem(("wall", i + 1), "is the same point as the corner before it; remove one of them")


def _images(sensed: Sensed, start: Array, end: Array) -> tuple[Array, Mask]:
    sensor, target = sensed.sensor, sensed.bodies.target
    pose, velocity = sensed.pose[:, :, None], sensed.velocity[:, :, None]
    length = np.hypot(*(end - start))
    ahead = (end - start) / length
    left = np.array([-ahead[1], ahead[0]])
    # Distances from the line of the wall, to its left.
    of_target = left[0] * (target[0] - start[0]) + left[1] * (target[1] - start[1])
    of_sensor = left[0] * (pose[0] - start[0]) + left[1] * (pose[1] - start[1])
    across = left[0] * target[2] + left[1] * target[3]
    turned = np.stack([of_target * left[0], of_target * left[1], across * left[0], across * left[1]])
    image = target - 2.0 * turned
    same_side = of_target * of_sensor > 0
    share = np.divide(of_sensor, of_sensor + of_target, out=np.zeros(same_side.shape), where=same_side)
    along = ahead[0] * (pose[0] - start[0]) + ahead[1] * (pose[1] - start[1])
    along = along + share * (ahead[0] * (image[0] - pose[0]) + ahead[1] * (image[1] - pose[1]))
    distance, azimuth = np.hypot(*(image[:2] - pose[:2])), np.arctan2(image[1] - pose[1], image[0] - pose[0])
    in_view = sensor.reaches(distance, wrap_angle(azimuth - pose[2]))
    return sensor.measure(image, pose, velocity), same_side & (along >= 0) & (along <= length) & in_view

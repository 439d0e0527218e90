"""A scene: one ground truth, the noise-free measurements of its sensors, and the bounds that follow from both."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.base.types import Indices, Truth
from trackbench.metrics.reference import ConditionalBound, Information, information
from trackbench.sensing.due import Due, find_due
from trackbench.sensing.scans import IdealSensor
from trackbench.sensing.scored_point import ScoredPoint, truth_of_point


@dataclass(frozen=True)
class Scene:
    """One ground truth with the noise-free measurements of its sensors."""

    truth: Truth
    sensors: list[IdealSensor]
    each_measurement: bool = False
    """Whether trackers are scored after each scan, and not once for all scans of one instant."""
    point: ScoredPoint = "centre"
    """Point of each body that estimates are compared with."""

    @cached_property
    def scored(self) -> Truth:
        """True motion of the scored point of each body."""
        return truth_of_point(self.truth, self.point)

    def instants(self) -> Indices:
        """Return the indices of the truth's steps at which trackers are scored: all steps with a measurement."""
        if not self.sensors:
            return np.arange(len(self.truth.time))
        steps = np.sort(np.concatenate([sensor.steps for sensor in self.sensors]))
        return steps if self.each_measurement else np.unique(steps)

    @cached_property
    def information(self) -> dict[str, Information]:
        """Fisher information on the targets in each sensor's measurements, by sensor."""
        return {sensor.name: information(sensor, self.truth) for sensor in self.sensors}

    @cached_property
    def bounds(self) -> dict[Hashable, ConditionalBound]:
        """Cache of Cramér-Rao bounds, by the sensors that a tracker reads and how its tracks start."""
        return {}

    @property
    def unlabelled(self) -> list[str]:
        """Names of the sensors with recorded detections that are not labelled with objects."""
        return [sensor.name for sensor in self.sensors if sensor.detections is not None]

    @cached_property
    def due(self) -> Due:
        """Which objects must be tracked, may be tracked or are absent at each instant, with hidden identities."""
        return find_due(self.truth, self.sensors)

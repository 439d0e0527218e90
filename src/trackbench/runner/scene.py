"""One truth, what its sensors would measure of it without noise, and the bounds that follow from both."""

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
    """One truth and what its sensors would read of it without noise."""

    truth: Truth
    sensors: list[IdealSensor]
    each_measurement: bool = False
    """Whether trackers are scored after each measurement, also where several are taken at one instant."""
    point: ScoredPoint = "centre"
    """The point of each body that estimates are compared with."""

    @cached_property
    def scored(self) -> Truth:
        """The motion that estimates are compared with."""
        return truth_of_point(self.truth, self.point)

    def instants(self) -> Indices:
        """Indices of the truth's steps at which any sensor takes a measurement; as often as trackers are scored."""
        if not self.sensors:
            return np.arange(len(self.truth.time))
        steps = np.sort(np.concatenate([sensor.steps for sensor in self.sensors]))
        return steps if self.each_measurement else np.unique(steps)

    @cached_property
    def information(self) -> dict[str, Information]:
        """By sensor, what its measurements tell of the targets."""
        return {sensor.name: information(sensor, self.truth) for sensor in self.sensors}

    @cached_property
    def bounds(self) -> dict[Hashable, ConditionalBound]:
        """Bounds of the errors of trackers, by the sensors that they read and how their tracks start."""
        return {}

    @property
    def unlabelled(self) -> list[str]:
        """The sensors of whose detections nothing says of which object they are."""
        return [sensor.name for sensor in self.sensors if sensor.detections is not None]

    @cached_property
    def due(self) -> Due:
        """Where identities are hidden, which objects should be tracked when."""
        return find_due(self.truth, self.sensors)

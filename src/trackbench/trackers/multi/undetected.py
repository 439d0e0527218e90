"""How many objects that no scan has found yet are in view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, FieldOfView, Scan
from trackbench.trackers.multi.gate import in_view

#: A field of view without a limit of range is taken to end here, m.
UNLIMITED_RANGE = 200.0


class View(NamedTuple):
    """What a sensor looked at in its latest scan."""

    field: FieldOfView
    pose: Array
    """``(3,)`` x m, y m, yaw rad of the sensor."""
    expected: float
    """Number of objects in it that no scan has found."""


class Undetected(NamedTuple):
    """The intensity of objects that no scan has found, uniform over each sensor's view.

    A scan that finds nothing speaks against objects in its own view, and against those of another sensor's as far as
    the two overlap.
    """

    unseen: float
    """PredictedTracks number in a view into which no sensor has looked yet."""
    views: Mapping[str, View]
    """By sensor."""

    def after_time(self, survival: float, born: float) -> Undetected:
        """Some of them leave, and others come into each view."""
        later = {name: view._replace(expected=view.expected * survival + born) for name, view in self.views.items()}
        return Undetected(self.unseen * survival + born, later)

    def in_view(self, sensor: str) -> float:
        """The expected number in the view of a sensor."""
        return self.views[sensor].expected if sensor in self.views else self.unseen

    def after_scan(self, scan: Scan, probability: float) -> Undetected:
        """What is left where the scan detects each object in its view with this probability."""
        field = scan.field_of_view or FieldOfView(np.pi, np.inf)
        views = {**self.views, scan.sensor: View(field, scan.sensor_pose, self.in_view(scan.sensor))}
        left = {
            name: view._replace(expected=view.expected * (1.0 - probability * seen_of(view, scan)))
            for name, view in views.items()
        }
        return Undetected(self.unseen, left)


def seen_of(view: View, scan: Scan) -> float:
    """The share of a view that a scan looks at."""
    reach = view.field.max_range if np.isfinite(view.field.max_range) else UNLIMITED_RANGE
    angle = view.pose[2] + view.field.half_angle * _ANGLES
    away = reach * _RADII
    return float(in_view(view.pose[:2, None] + away * np.array([np.cos(angle), np.sin(angle)]), scan).mean())


#: Points of equal share of a sector: of its half angle, and of its radius.
_ANGLES, _RADII = (
    part.ravel() for part in np.meshgrid((np.arange(16) - 7.5) / 8, np.sqrt((np.arange(8) + 0.5) / 8), indexing="ij")
)

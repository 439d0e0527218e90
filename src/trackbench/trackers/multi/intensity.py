"""How many detections of no track a scan has, per unit volume of the space in which the filter compares."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import FieldOfView, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.associate import AssociateConfig
from trackbench.trackers.multi.undetected import UNLIMITED_RANGE

#: Fewest false alarms in a scan that a tracker reckons with: "never" would let it take any detection for an object.
FEWEST_FALSE_ALARMS = 1e-3


class Intensity(NamedTuple):
    """Detections per unit volume and scan."""

    false_alarms: float
    new_objects: float
    """Of objects that exist and have no track, if they were detected for certain."""


def intensity(
    scan: Scan, components: int, config: AssociateConfig, undetected: float, velocity_sigma: float
) -> Intensity:
    """What is expected in a scan.

    False alarms and objects without a track are taken to be uniform over the field of view. A filter that compares
    positions takes all false alarms in view, spread over its area.

    Args:
        scan: says what the sensor states.
        components: of what the filter compares: fewer than the scan has where it converts them to a position.
        config: may override what the sensor states.
        undetected: expected number of objects in view that no scan has found.
        velocity_sigma: standard deviation of an object's velocity, m/s.
    """
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    measured, positions = volumes(scan.kind, view, velocity_sigma)
    stated = config.clutter_density.get(scan.sensor, scan.clutter_density or 0.0)
    volume = view.volume or measured
    false_alarms = max(stated * volume, FEWEST_FALSE_ALARMS)
    if components == len(scan.measurement):
        return Intensity(false_alarms / volume, undetected / measured)
    return Intensity(false_alarms / positions, undetected / positions)


@lru_cache(maxsize=64)
def volumes(kind: str, view: FieldOfView, velocity_sigma: float) -> tuple[float, float]:
    """Of the measurement space, in its units, and of the field of view, m^2.

    The measurement's derivative half-way to the largest range says by how much an area is stretched (for range and
    azimuth this is exact); a component that the velocity moves has the width of its distribution, sqrt(2 pi) sigma.
    """
    sensor = SENSOR_MODELS[kind]
    reach = view.max_range if np.isfinite(view.max_range) else UNLIMITED_RANGE
    area = view.half_angle * reach**2
    h = sensor.jacobian(np.array([reach / 2, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(2))
    rest = linalg.matmul_transposed(h[2:, 2:], h[2:, 2:]) * 2 * np.pi * velocity_sigma**2
    stretch = abs(np.linalg.det(h[:2, :2])) * np.sqrt(np.linalg.det(rest))
    return float(area * stretch), area

"""How many detections of no track a scan has, per unit volume of the space in which the filter compares."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.associate import AssociateConfig
from trackbench.types import FieldOfView, Scan

#: A field of view without a limit of range is taken to end here, m.
UNLIMITED_RANGE = 200.0
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

    False alarms and objects without a track are taken to be uniform over the measurement space.

    Args:
        scan: says what the sensor states.
        components: of what the filter compares: fewer than the scan has where it converts them to a position.
        config: may override what the sensor states.
        undetected: expected number of objects in the field of view that have no track.
        velocity_sigma: standard deviation of an object's velocity, m/s.
    """
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    measured, positions = volumes(scan.kind, view, velocity_sigma)
    stated = config.clutter_density.get(scan.sensor, scan.clutter_density or 0.0)
    volume = measured if components == len(scan.measurement) else positions
    return Intensity(max(stated * measured, FEWEST_FALSE_ALARMS) / volume, undetected / volume)


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

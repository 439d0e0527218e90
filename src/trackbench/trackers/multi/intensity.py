"""Expected numbers of undetected objects, new objects and false alarms; detection probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, FieldOfView, Scan
from trackbench.filters import AnyBelief, Filter
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.detection import detected_share
from trackbench.trackers.associate import AssociateConfig, GaussianBirths
from trackbench.trackers.assume import AssumedSensors, distance_from_sensor, measured_distance
from trackbench.trackers.multi.gate import in_field_of_view

#: Assumed range of a field of view without a limit, m.
UNLIMITED_RANGE = 200.0


class View(NamedTuple):
    """Field of view of a sensor at its latest scan, with the number of undetected objects expected in it."""

    field: FieldOfView
    pose: Array
    """Pose of the sensor, ``(3,)`` or ``(3, runs)``: x m, y m, yaw rad in the fixed frame."""
    expected: float | Array
    """Expected number of objects in the field of view that no scan has detected."""


class Undetected(NamedTuple):
    """Expected number of objects that no scan has detected, uniform over each sensor's field of view.

    A scan lowers the number in its own field of view, and in other fields of view by their overlap with it.
    """

    unseen: float
    """Expected number of objects in a field of view before its first scan."""
    views: Mapping[str, View]
    """Latest field of view of each sensor, by the sensor's name."""

    def after_time(self, survival: float, born: float) -> Undetected:
        """Return the expected numbers of undetected objects later: a share ``survival`` stays, and ``born`` appear."""
        later = {name: view._replace(expected=view.expected * survival + born) for name, view in self.views.items()}
        return Undetected(self.unseen * survival + born, later)

    def in_view(self, sensor: str) -> float | Array:
        """Return the expected number of undetected objects in a sensor's view, ``(runs,)`` if runs differ."""
        return self.views[sensor].expected if sensor in self.views else self.unseen

    def after_scan(self, scan: Scan, probability: float, half_range_m: float | None = None) -> Undetected:
        """Return the expected numbers after a scan with P_D ``probability``, halved at the range ``half_range_m``."""
        field = scan.field_of_view or FieldOfView(np.pi, np.inf)
        views = {**self.views, scan.sensor: View(field, scan.sensor_pose, self.in_view(scan.sensor))}
        remaining = {}
        for name, view in views.items():
            # The scan covers all of its own view.
            is_own_view = name == scan.sensor and half_range_m is None
            share = 1.0 if is_own_view else seen_share(view, scan, half_range_m)
            remaining[name] = view._replace(expected=view.expected * (1.0 - probability * share))
        return Undetected(self.unseen, remaining)


def seen_share(view: View, scan: Scan, half_range_m: float | None = None) -> float | Array:
    """Return the share of a view that a scan covers, ``(runs,)`` if sensors differ between runs.

    With ``half_range_m``, the range at which half of the objects are detected, it is the share of detected objects.
    """
    reach = view.field.max_range if np.isfinite(view.field.max_range) else UNLIMITED_RANGE
    poses = np.concatenate([view.pose, scan.sensor_pose]).reshape(6, -1)
    # Neighbouring runs of a scene share their sensors, so that each scene is computed once.
    is_first = np.concatenate([[True], (poses[:, 1:] != poses[:, :-1]).any(axis=0)])
    # Points along the first axis, scenes along the second.
    pose, of_scan = poses[:, None, is_first].reshape(2, 3, 1, -1)
    scan = scan._replace(sensor_pose=of_scan)
    angle = pose[2] + view.field.half_angle * _ANGLES[:, None]
    distance = reach * _RADII[:, None]
    points = pose[:2] + distance * np.array([np.cos(angle), np.sin(angle)])
    detected = 1.0 if half_range_m is None else detected_share(distance_from_sensor(points, scan), half_range_m)
    # The order of the sum must not depend on the number of runs.
    share: Array = np.add.accumulate(in_field_of_view(points, scan) * detected, axis=0)[-1] / len(_RADII)
    return float(share[0]) if view.pose.ndim == 1 else share[is_first.cumsum() - 1]


#: Points that stand for equal areas of a sector, as shares of its half angle and of its radius.
_ANGLES, _RADII = (
    part.ravel() for part in np.meshgrid((np.arange(16) - 7.5) / 8, np.sqrt((np.arange(8) + 0.5) / 8), indexing="ij")
)


#: Fewest false alarms assumed in a scan: with none, any detection would count as an object.
FEWEST_FALSE_ALARMS = 1e-3


class Intensity(NamedTuple):
    """Densities of false alarms and of new objects' detections, per unit volume of the measurement space and scan."""

    false_alarms: float
    new_objects: float | Array
    """Density of detections of objects without a track, ``(N,)`` if it differs between detections."""


def intensity(
    scan: Scan,
    as_measured: bool,
    config: AssociateConfig,
    undetected: float | Array,
    detection: float | Array,
    velocity_sigma: float,
) -> Intensity:
    """Return the densities of a scan's detections that are false alarms or stem from objects without a track.

    Both are uniform over the field of view, unless the options state a Gaussian for objects without a track. For a
    filter that compares positions, the false alarms are spread over the area of the view.

    Args:
        scan: detections, and what the sensor states.
        as_measured: whether the filter compares measurements; else it converts them to positions.
        config: options, which say where objects without a track are expected.
        undetected: expected number of objects in the field of view that no scan has detected; a number or ``(N,)``.
        detection: P_D, or P_D at each detection ``(N,)``.
        velocity_sigma: standard deviation of an object's velocity, m/s.
    """
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    measured, positions = volumes(scan.kind, view, velocity_sigma)
    volume = view.volume or measured
    false_alarms = max((scan.clutter_density or 0.0) * volume, FEWEST_FALSE_ALARMS)
    births = config.birth_density
    new_objects = undetected / (measured if as_measured else positions) * detection
    if isinstance(births, GaussianBirths) and (sensor := SENSOR_MODELS[scan.kind]).measures_position():
        place, noise = sensor.position(scan)
        factor = linalg.cholesky(noise + linalg.expand(births.sigma_m**2 * np.eye(2), noise))
        offset = place - linalg.expand(np.array([births.x, births.y]), place)
        new_objects = undetected * np.exp(factor.log_density(factor.whiten(offset))) * detection
        if as_measured:
            new_objects /= volume_per_area(scan.kind, measured_distance(scan), velocity_sigma)
    return Intensity(false_alarms / (volume if as_measured else positions), new_objects)


@lru_cache(maxsize=64)
def volumes(kind: str, view: FieldOfView, velocity_sigma: float) -> tuple[float, float]:
    """Return the volume of the field of view in the measurement space, and its area, m^2.

    For range and azimuth the scale factor at half the largest range is exact. If only one component depends on the
    position, a length along or across the line of sight is scaled.
    """
    sensor = SENSOR_MODELS[kind]
    reach = view.max_range if np.isfinite(view.max_range) else UNLIMITED_RANGE
    area = view.half_angle * reach**2
    if sensor.measures_position():
        return float(area * volume_per_area(kind, np.array(reach / 2), velocity_sigma)), area
    h = sensor.jacobian(np.array([reach / 2, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(2))
    places = sum(unit != "m/s" for unit in sensor.units)
    rates = linalg.matmul_transposed(h[places:, 2:], h[places:, 2:]) * 2 * np.pi * velocity_sigma**2
    extent = h[:places, :2] * [reach, view.half_angle * reach]
    return float(np.sqrt(np.linalg.det(linalg.matmul_transposed(extent, extent)) * np.linalg.det(rates))), area


def volume_per_area(kind: str, distance: Array, velocity_sigma: float) -> Array:
    """Return the volume of the measurement space per area of positions at distances ``(...)`` from the sensor, m.

    The measurement's derivative scales the area. A component that depends on the velocity contributes the width of its
    distribution, sqrt(2 pi) sigma.
    """
    zero = np.zeros_like(distance)
    h = SENSOR_MODELS[kind].jacobian(np.array([distance, zero, zero, zero]), np.zeros(3), np.zeros(2))
    rates = linalg.matmul_transposed(h[2:, 2:], h[2:, 2:]) * 2 * np.pi * velocity_sigma**2
    of_position, of_velocity = (np.linalg.det(np.moveaxis(part, (0, 1), (-2, -1))) for part in (h[:2, :2], rates))
    return np.asarray(np.abs(of_position) * np.sqrt(of_velocity))


@dataclass(frozen=True)
class Detectability:
    """Detection probabilities that a tracker assumes for each sensor."""

    overrides: Mapping[str, float]
    """Assumed P_D by the sensor's name, in place of the stated one."""
    assumed: AssumedSensors

    def stated(self, scan: Scan) -> float:
        """Return the P_D at close range of an object in the field of view: assumed, else as the sensor states it."""
        stated = 1.0 if scan.detection_probability is None else scan.detection_probability
        return self.overrides.get(scan.sensor, stated)

    def half_range_m(self, scan: Scan) -> float | None:
        """Return the range, m, at which P_D is half: assumed, else as the sensor states it; None for a constant P_D."""
        signal = self.assumed.signal(scan.sensor) if self.assumed.effects else None
        return scan.half_range_m if signal is None else signal.half_range_m

    def probabilities(
        self, filter: Filter[Any], belief: AnyBelief, at_tracks: Scan, scan: Scan
    ) -> tuple[float | Array, float | Array]:
        """Return the P_D at each track ``(L,)`` and at each detection ``(N,)``, as if all were in the field of view.

        Args:
            filter: filter that made the beliefs.
            belief: belief of the tracks.
            at_tracks: scan with the sensor's pose for each track, whose run may have a pose of its own.
            scan: scan with the detections.
        """
        stated, half_range_m = float(self.stated(scan)), self.half_range_m(scan)
        if half_range_m is None:
            return stated, stated
        position = filter.cartesian(belief).mean[:2]
        of_tracks = stated * detected_share(distance_from_sensor(position, at_tracks), half_range_m)
        return of_tracks, stated * detected_share(measured_distance(scan), half_range_m)

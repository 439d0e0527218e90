"""Expected numbers of objects that no scan has found, of new objects and of false alarms; detection probabilities."""

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

#: A field of view without a limit of range is taken to end here, m.
UNLIMITED_RANGE = 200.0


class View(NamedTuple):
    """What a sensor looked at in its latest scan."""

    field: FieldOfView
    pose: Array
    """``(3,)`` or ``(3, runs)`` x m, y m, yaw rad of the sensor."""
    expected: float | Array
    """Number of objects in it that no scan has found."""


class Undetected(NamedTuple):
    """The intensity of objects that no scan has found, uniform over each sensor's view.

    A scan that finds nothing speaks against objects in its own view, and against those of another sensor's as far as
    the two overlap.
    """

    unseen: float
    """Expected number in a view into which no sensor has looked yet."""
    views: Mapping[str, View]
    """By sensor."""

    def after_time(self, survival: float, born: float) -> Undetected:
        """Some of them leave, and others come into each view."""
        later = {name: view._replace(expected=view.expected * survival + born) for name, view in self.views.items()}
        return Undetected(self.unseen * survival + born, later)

    def in_view(self, sensor: str) -> float | Array:
        """The expected number in the view of a sensor, of each run ``(runs,)`` where sensors differ between runs."""
        return self.views[sensor].expected if sensor in self.views else self.unseen

    def after_scan(self, scan: Scan, probability: float, half_range_m: float | None = None) -> Undetected:
        """What is left where the scan detects each object in its view with this probability, halved at a range in m."""
        field = scan.field_of_view or FieldOfView(np.pi, np.inf)
        views = {**self.views, scan.sensor: View(field, scan.sensor_pose, self.in_view(scan.sensor))}
        left = {}
        for name, view in views.items():
            # Of its own view the scan sees all.
            own = name == scan.sensor and half_range_m is None
            share = 1.0 if own else seen_share(view, scan, half_range_m)
            left[name] = view._replace(expected=view.expected * (1.0 - probability * share))
        return Undetected(self.unseen, left)


def seen_share(view: View, scan: Scan, half_range_m: float | None = None) -> float | Array:
    """The share of a view that a scan looks at, or of the objects in it that it detects where it detects half of those
    at a range in m; ``(runs,)`` where sensors differ between runs."""
    reach = view.field.max_range if np.isfinite(view.field.max_range) else UNLIMITED_RANGE
    both = np.concatenate([view.pose, scan.sensor_pose]).reshape(6, -1)
    # Runs of one scene stand together, with the same sensors: of each scene once.
    first = np.concatenate([[True], (both[:, 1:] != both[:, :-1]).any(axis=0)])
    # Points along the first axis, scenes along the second.
    pose, of_scan = both[:, None, first].reshape(2, 3, 1, -1)
    scan = scan._replace(sensor_pose=of_scan)
    angle = pose[2] + view.field.half_angle * _ANGLES[:, None]
    away = reach * _RADII[:, None]
    points = pose[:2] + away * np.array([np.cos(angle), np.sin(angle)])
    detected = 1.0 if half_range_m is None else detected_share(distance_from_sensor(points, scan), half_range_m)
    # In one order, whatever the number of runs.
    share: Array = np.add.accumulate(in_field_of_view(points, scan) * detected, axis=0)[-1] / len(_RADII)
    return float(share[0]) if view.pose.ndim == 1 else share[first.cumsum() - 1]


#: Points of equal share of a sector: of its half angle, and of its radius.
_ANGLES, _RADII = (
    part.ravel() for part in np.meshgrid((np.arange(16) - 7.5) / 8, np.sqrt((np.arange(8) + 0.5) / 8), indexing="ij")
)


#: Fewest false alarms in a scan that a tracker reckons with: "never" would let it take any detection for an object.
FEWEST_FALSE_ALARMS = 1e-3


class Intensity(NamedTuple):
    """Detections per unit volume and scan."""

    false_alarms: float
    new_objects: float | Array
    """Of objects that have no track, ``(N,)`` where each detection is if it differs."""


def intensity(
    scan: Scan,
    as_measured: bool,
    config: AssociateConfig,
    undetected: float | Array,
    detection: float | Array,
    velocity_sigma: float,
) -> Intensity:
    """Return the densities of false alarms and of objects without a track in a scan.

    False alarms are uniform over the field of view; objects without a track too, unless the options state a Gaussian.
    A filter that compares positions takes all false alarms in view, spread over its area.

    Args:
        scan: says what the sensor states.
        as_measured: whether the filter compares the measurements as they are; else it converts them to positions.
        config: says where objects without a track are expected.
        undetected: expected number of objects in view that no scan has found, ``(N,)`` where it differs.
        detection: probability that an object is detected, ``(N,)`` where each detection is if it differs.
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
        away = place - linalg.expand(np.array([births.x, births.y]), place)
        new_objects = undetected * np.exp(factor.log_density(factor.whiten(away))) * detection
        if as_measured:
            new_objects /= volume_per_area(scan.kind, measured_distance(scan), velocity_sigma)
    return Intensity(false_alarms / (volume if as_measured else positions), new_objects)


@lru_cache(maxsize=64)
def volumes(kind: str, view: FieldOfView, velocity_sigma: float) -> tuple[float, float]:
    """Return the volume of the measurement space, in its units, and the area of the field of view, m^2.

    For range and azimuth the stretch of an area half-way to the largest range is exact. Where one component alone
    depends on the position, a length along or across the line of sight is stretched.
    """
    sensor = SENSOR_MODELS[kind]
    reach = view.max_range if np.isfinite(view.max_range) else UNLIMITED_RANGE
    area = view.half_angle * reach**2
    if sensor.measures_position():
        return float(area * volume_per_area(kind, np.array(reach / 2), velocity_sigma)), area
    h = sensor.jacobian(np.array([reach / 2, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(2))
    places = sum(unit != "m/s" for unit in sensor.units)
    rest = linalg.matmul_transposed(h[places:, 2:], h[places:, 2:]) * 2 * np.pi * velocity_sigma**2
    seen = h[:places, :2] * [reach, view.half_angle * reach]
    return float(np.sqrt(np.linalg.det(linalg.matmul_transposed(seen, seen)) * np.linalg.det(rest))), area


def volume_per_area(kind: str, distance: Array, velocity_sigma: float) -> Array:
    """Return the volume of the measurement space per area of positions, at distances ``(...)`` from the sensor, m.

    The measurement's derivative says by how much an area is stretched. A component that the velocity moves has the
    width of its distribution, sqrt(2 pi) sigma.
    """
    zero = np.zeros_like(distance)
    h = SENSOR_MODELS[kind].jacobian(np.array([distance, zero, zero, zero]), np.zeros(3), np.zeros(2))
    rest = linalg.matmul_transposed(h[2:, 2:], h[2:, 2:]) * 2 * np.pi * velocity_sigma**2
    of_position, of_velocity = (np.linalg.det(np.moveaxis(part, (0, 1), (-2, -1))) for part in (h[:2, :2], rest))
    return np.asarray(np.abs(of_position) * np.sqrt(of_velocity))


@dataclass(frozen=True)
class Detectability:
    """The detection probabilities that a tracker takes."""

    overrides: Mapping[str, float]
    """By the sensor's name, in place of what the sensor states."""
    assumed: AssumedSensors

    def stated(self, scan: Scan) -> float:
        """Of an object in view of the scan's sensor, at any distance."""
        stated = 1.0 if scan.detection_probability is None else scan.detection_probability
        return self.overrides.get(scan.sensor, stated)

    def half_range_m(self, scan: Scan) -> float | None:
        """Range at which half of these objects are detected, m: assumed, or as the scan states it."""
        signal = self.assumed.signal(scan.sensor) if self.assumed.effects else None
        return scan.half_range_m if signal is None else signal.half_range_m

    def probabilities(
        self, filter: Filter[Any], belief: AnyBelief, at_tracks: Scan, scan: Scan
    ) -> tuple[float | Array, float | Array]:
        """Of an object where each track ``(L,)`` and where each detection ``(N,)`` is, were it in view.

        Args:
            filter: of the beliefs.
            belief: of the tracks.
            at_tracks: the scan with the sensor of each track.
            scan: with the detections.
        """
        stated, half_range_m = float(self.stated(scan)), self.half_range_m(scan)
        if half_range_m is None:
            return stated, stated
        position = filter.cartesian(belief).mean[:2]
        of_tracks = stated * detected_share(distance_from_sensor(position, at_tracks), half_range_m)
        return of_tracks, stated * detected_share(measured_distance(scan), half_range_m)

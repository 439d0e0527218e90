"""The first measurements of objects, from which their tracks start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.types import Array, Indices, Mask, Scan

#: Those before the latest so many are not used.
MOST_MEASUREMENTS = 30
#: Decimals to which intervals are told apart: times are sums of periods, which are not exact.
CLOCK = 9


class FirstMeasurements(NamedTuple):
    """The K measurements of each of L objects at most, in order of time; those that an object lacks come last."""

    interval: Array
    """``(K - 1, L)`` s from each to the next; 0 to one that there is not."""
    kinds: tuple[type[Sensor], ...]
    kind: Indices
    """``(K, L)`` number of its sensor's kind; -1 where there is no measurement."""
    value: Array
    """``(m, K, L)``, padded with zeros to the longest measurement, as the next one."""
    whitener: Array
    """``(m, m, K, L)`` inverse of the lower Cholesky factor of its noise covariance."""
    pose: Array
    """``(3, K, L)`` of the sensor."""
    velocity: Array
    """``(2, K, L)`` of the sensor."""
    position: Array
    """``(2, L)`` that the first one states."""

    @property
    def by_range_rate(self) -> Mask:
        """``(L,)`` whether all of an object's measurements have a range rate."""
        with_rate = np.array([*("range_rate" in sensor.components for sensor in self.kinds), True])
        return np.asarray(with_rate[self.kind].all(axis=0))

    def part(self, where: Mask | slice) -> FirstMeasurements:
        """Those of some objects."""
        return FirstMeasurements(
            *(item if name == "kinds" else item[..., where] for name, item in self._asdict().items())
        )


def collect(scans: Sequence[Scan], taken: Mask) -> FirstMeasurements:
    """The measurements of some objects.

    Args:
        scans: in order of time, measurements ``(m, L)``.
        taken: ``(scans, L)`` which of them count; the last for every object.
    """
    used = taken & (np.cumsum(taken[::-1], axis=0)[::-1] <= MOST_MEASUREMENTS)
    # Stable: of each object those that are used come first, in their order.
    number = np.argsort(~used, axis=0, kind="stable")[: int(used.sum(axis=0).max())]
    there = np.take_along_axis(used, number, axis=0)
    kinds = tuple(dict.fromkeys(SENSOR_MODELS[scan.kind] for scan in scans))
    size = max(len(scan.measurement) for scan in scans)
    value = np.zeros((len(scans), size, taken.shape[1]))
    lanes = np.arange(taken.shape[1])
    whitener = np.zeros((len(scans), len(lanes), size, size))
    for i, scan in enumerate(scans):
        own = len(scan.measurement)
        value[i, :own] = np.where(scan.valid, scan.measurement, 0.0)
        noise = np.moveaxis(scan.noise_covariance, (0, 1), (-2, -1))
        whitener[i, :, :own, :own] = np.linalg.inv(np.linalg.cholesky(noise))
    time = np.array([scan.time for scan in scans])[number]
    kind = np.array([kinds.index(SENSOR_MODELS[scan.kind]) for scan in scans])[number]
    position = np.stack([SENSOR_MODELS[scan.kind].position(scan).mean for scan in scans])
    return FirstMeasurements(
        np.where(there[1:], np.round(np.diff(time, axis=0), CLOCK), 0.0),
        kinds,
        np.where(there, kind, -1),
        np.ascontiguousarray(np.moveaxis(np.take_along_axis(value, number[:, None], axis=0), 1, 0)),
        np.ascontiguousarray(np.moveaxis(whitener[number, lanes], (2, 3), (0, 1)) * there),
        np.ascontiguousarray(np.moveaxis(np.stack([scan.sensor_pose for scan in scans])[number], 2, 0)),
        np.ascontiguousarray(np.moveaxis(np.stack([scan.sensor_velocity for scan in scans])[number], 2, 0)),
        position[number[0], :, lanes].T,
    )


def places(where: Mask) -> Any:
    """Indices ``(K, L)`` of where a mask holds: whole rows, where it is the same for all objects."""
    rows = np.asarray(where.any(axis=1))
    return (
        (rows, slice(None)) if np.array_equal(where, np.broadcast_to(rows[:, None], where.shape)) else where.nonzero()
    )

"""The first measurements of objects, from which their tracks start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan, some
from trackbench.models.sensors import SENSOR_MODELS, Sensor

#: Those before the latest so many are not used.
MOST_MEASUREMENTS = 30
#: Decimals to which intervals are told apart: times are sums of periods, which are not exact.
CLOCK = 9


class FirstMeasurements(NamedTuple):
    """The K measurements of each of L objects at most, in order of time; those that an object lacks come last."""

    interval: Array
    """``(K - 1, L)`` s from each to the next; 0 to one that there is not."""
    kinds: tuple[type[Sensor], ...]
    of_kind: Mask
    """``(K, kinds, L)`` of which kind its sensor is; of none where there is no measurement."""
    value: Array
    """``(K, m, L)``, padded with zeros to the longest measurement, as the next one."""
    whitener: Array
    """``(K, m, m, L)`` inverse of the lower Cholesky factor of its noise covariance."""
    pose: Array
    """``(K, 3, L)`` of the sensor."""
    velocity: Array
    """``(K, 2, L)`` of the sensor."""
    position: Array
    """``(2, L)`` that the first one states."""

    @property
    def by_range_rate(self) -> Mask:
        """``(L,)`` whether all of an object's measurements have a range rate."""
        without = [number for number, kind in enumerate(self.kinds) if "range_rate" not in kind.components]
        return np.asarray(~self.of_kind[:, without].any(axis=(0, 1)))

    def part(self, where: Mask) -> FirstMeasurements:
        """Those of some objects."""
        return FirstMeasurements(
            *(item if name == "kinds" else some(item, where) for name, item in self._asdict().items())
        )

    def at(self, k: int) -> dict[str, Array]:
        """Each object's measurement of that number, as equations take it."""
        return {
            "value": self.value[k],
            "whitener": self.whitener[k],
            "pose": self.pose[k],
            "velocity": self.velocity[k],
            "of_kind": self.of_kind[k],
        }


def kinds_of(scans: Sequence[Scan]) -> tuple[type[Sensor], ...]:
    """The kinds of their sensors, in an order that does not depend on the scans'."""
    return tuple(SENSOR_MODELS[kind] for kind in sorted({scan.kind for scan in scans}))


def collect(scans: Sequence[Scan], taken: Mask, kinds: tuple[type[Sensor], ...]) -> FirstMeasurements:
    """The measurements of some objects.

    Args:
        scans: in order of time, measurements ``(m, L)``.
        taken: ``(scans, L)`` which of them count; the last for every object.
        kinds: those of their sensors, or more.
    """
    used = taken & (np.cumsum(taken[::-1], axis=0)[::-1] <= MOST_MEASUREMENTS)
    # Stable: of each object those that are used come first, in their order.
    number = np.argsort(~used, axis=0, kind="stable")[: int(used.sum(axis=0).max())]
    there = np.take_along_axis(used, number, axis=0)
    size = max(len(kind.components) for kind in kinds)
    value = np.zeros((len(scans), size, taken.shape[1]))
    lanes = np.arange(taken.shape[1])
    whitener = np.zeros((len(scans), len(lanes), size, size))
    for i, scan in enumerate(scans):
        own = len(scan.measurement)
        value[i, :own] = np.where(scan.valid, scan.measurement, 0.0)
        noise = np.moveaxis(scan.noise_covariance, (0, 1), (-2, -1))
        whitener[i, :, :own, :own] = np.linalg.inv(np.linalg.cholesky(noise))
    time = np.array([scan.time for scan in scans])[number]
    of_kind = np.array([[SENSOR_MODELS[scan.kind] is kind for kind in kinds] for scan in scans])[number]
    position = np.stack([SENSOR_MODELS[scan.kind].position(scan).mean for scan in scans])
    return FirstMeasurements(
        np.where(there[1:], np.round(np.diff(time, axis=0), CLOCK), 0.0),
        kinds,
        np.ascontiguousarray(np.moveaxis(of_kind & there[..., None], 2, 1)),
        np.take_along_axis(value, number[:, None], axis=0),
        np.ascontiguousarray(np.moveaxis(whitener[number, lanes] * there[..., None, None], 1, 3)),
        np.ascontiguousarray(np.moveaxis(np.stack([scan.sensor_pose for scan in scans])[number], 2, 1)),
        np.ascontiguousarray(np.moveaxis(np.stack([scan.sensor_velocity for scan in scans])[number], 2, 1)),
        np.ascontiguousarray(position[number[0], :, lanes].T),
    )

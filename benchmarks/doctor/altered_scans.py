"""Scans with an error: one function for each mistake."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackbench.base.types import Array, Scan
from trackbench.base.units import wrap_angle

Alter = Callable[[Scan], Scan]

RANGE, AZIMUTH, RATE = range(3)
X, Y, YAW = range(3)


def component(kind: str, index: int | slice, change: Callable[[Array], Array]) -> Alter:
    """One component of one sensor's measurements, changed."""

    def alter(scan: Scan) -> Scan:
        if scan.kind != kind:
            return scan
        measurement = scan.measurement.copy()
        measurement[index] = change(measurement[index])
        return scan._replace(measurement=measurement)

    return alter


def offset(kind: str, index: int, bias: float) -> Alter:
    return component(kind, index, lambda value: value + bias)


def scaled(kind: str, index: int | slice, factor: float) -> Alter:
    return component(kind, index, lambda value: factor * value)


def azimuth(change: Callable[[Array], Array]) -> Alter:
    return component("radar", AZIMUTH, lambda angle: wrap_angle(change(angle)))


def scaled_noise(factor: float, kind: str | None = None, index: int | None = None) -> Alter:
    """The covariance of one sensor or of all (or one of its variances, uncorrelated), times a factor."""

    def alter(scan: Scan) -> Scan:
        if kind not in (None, scan.kind):
            return scan
        scale = np.full(len(scan.noise_covariance), factor)
        if index is not None:
            scale = np.ones(len(scan.noise_covariance))
            scale[index] = factor
        return scan._replace(noise_covariance=scan.noise_covariance * np.sqrt(np.outer(scale, scale)))

    return alter


def pose(index: int | slice, change: Callable[[Array], Array]) -> Alter:
    def alter(scan: Scan) -> Scan:
        changed = scan.sensor_pose.copy()
        changed[index] = change(changed[index])
        return scan._replace(sensor_pose=changed)

    return alter


def velocity_ignored(scan: Scan) -> Scan:
    return scan._replace(sensor_velocity=np.zeros(2))


def lidar_axes_swapped(scan: Scan) -> Scan:
    return scan._replace(measurement=scan.measurement[::-1]) if scan.kind == "lidar" else scan


def dropped(kind: str) -> Alter:
    """One sensor's measurements, marked as missed."""

    def alter(scan: Scan) -> Scan:
        return scan._replace(valid=np.zeros_like(scan.valid)) if scan.kind == kind else scan

    return alter


def missed_used_as_valid(scan: Scan) -> Scan:
    """Every measurement marked as valid; missed ones are NaN."""
    return scan._replace(valid=np.ones_like(scan.valid))


def drawn(scale: float) -> Alter:
    """The measurement with noise from an unseeded generator, of ``scale`` times its standard deviations."""

    def alter(scan: Scan) -> Scan:
        sigma = scale * np.sqrt(np.diag(scan.noise_covariance))
        normal = np.random.default_rng().standard_normal(scan.measurement.shape)
        return scan._replace(measurement=scan.measurement + (sigma * normal.T).T)

    return alter

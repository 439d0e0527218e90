"""Objects that a sensor cannot tell apart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.base.units import difference, wrap_angle
from trackbench.sensing.scans import IdealSensor


class Resolved(NamedTuple):
    """Detections of one sensor in one run, after those that it cannot tell apart have become one."""

    measurement: Array
    """``(m, instants, objects)``."""
    detected: Mask
    """``(instants, objects)``: False for an object whose detection went into that of another."""
    second: Indices
    """``(instants, objects)``: the object with the second largest share of a merged detection, else -1."""


def resolve(sensor: IdealSensor, measurement: Array, detected: Mask, run: int) -> Resolved:
    """Merge the detections of objects that are in one cell of range, azimuth and range rate.

    Two objects are, where they differ by less than the cell in each of them; a chain of such pairs is one group. A
    group gives one measurement, at the mean of its members weighted by their received power (proportional to
    ``range^-4``, all of one cross-section), with the noise of the strongest.

    Source: Daum and Fitzgerald (1994), "The importance of resolution in multiple-target tracking"; Koch and van Keuk
    (1997), "Multiple hypothesis track maintenance with possibly unresolved measurements", for the limit on differences.

    Args:
        sensor: what it would read without noise.
        measurement: ``(m, instants, objects)`` with noise.
        detected: ``(instants, objects)``.
        run: the number of the run.
    """
    assert sensor.polar is not None
    of_run = run if sensor.polar.shape[-1] > 1 else 0
    seen, ideal = sensor.polar[..., of_run], sensor.measurement[..., of_run]
    second = np.full(detected.shape, -1)
    linked = _linked(sensor, seen, detected)
    rows = np.flatnonzero(linked.any(axis=(1, 2)))
    if not len(rows):
        return Resolved(measurement, detected, second)
    group = _groups(linked[rows])
    power = np.where(detected[rows], seen[0][rows] ** -4.0, 0.0)
    together = (group[:, :, None] == group[:, None, :]) & detected[rows][:, None, :]
    shares = np.where(together, power[:, None, :], 0.0)
    strongest = np.argmax(shares, axis=-1)
    leads = detected[rows] & (strongest == np.arange(detected.shape[1]))
    shares = shares / np.maximum(shares.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    between = difference(ideal[:, rows][:, :, None, :], ideal[:, rows][:, :, :, None], sensor.config.angular)
    offset = np.einsum("kij,mkij->mki", shares, between)
    merged, found = measurement.copy(), detected.copy()
    merged[:, rows] = difference(measurement[:, rows], -offset, sensor.config.angular)
    found[rows] = leads
    others = np.where(np.eye(detected.shape[1], dtype=bool), 0.0, shares)
    partner = np.where(others.max(axis=-1) > 0.0, np.argmax(others, axis=-1), -1)
    second[rows] = np.where(leads, partner, -1)
    return Resolved(np.where(found, merged, np.nan), found, second)


def _linked(sensor: IdealSensor, seen: Array, detected: Mask) -> Mask:
    """``(instants, objects, objects)``: two detected objects in one cell."""
    cell = sensor.config.resolution
    assert cell is not None
    linked = detected[:, :, None] & detected[:, None, :] & ~np.eye(detected.shape[1], dtype=bool)
    if cell.range_m is not None:
        linked &= np.abs(seen[0][:, :, None] - seen[0][:, None, :]) < cell.range_m
    if cell.azimuth_deg is not None:
        apart = wrap_angle(seen[1][:, :, None] - seen[1][:, None, :])
        linked &= np.abs(apart) < np.deg2rad(cell.azimuth_deg)
    if cell.range_rate_mps is not None:
        linked &= np.abs(seen[2][:, :, None] - seen[2][:, None, :]) < cell.range_rate_mps
    return linked


def _groups(linked: Mask) -> Indices:
    """``(instants, objects)`` the least number of the objects that each is linked with, directly or through others."""
    count = linked.shape[1]
    reached = linked | np.eye(count, dtype=bool)
    group = np.broadcast_to(np.arange(count), linked.shape[:2])
    while True:
        lower = np.where(reached, group[:, None, :], count).min(axis=-1)
        if np.array_equal(lower, group):
            return np.asarray(lower)
        group = lower

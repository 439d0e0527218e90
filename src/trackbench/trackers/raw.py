"""Baseline tracker without a filter."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.initial import two_measurements

#: Published name of the tracker.
BASELINE = "raw"


class PositionFix(NamedTuple):
    """Position that a measurement states, with the time of the measurement."""

    time: Array
    """Time of the measurement ``(...)``, s; NaN for an object without a measurement."""
    position: Gaussian
    """Position ``(2, ...)`` in the fixed frame, m, with its covariance."""


class RawState(NamedTuple):
    """Measured positions of each object at the latest two instants at which the object was measured."""

    last: PositionFix
    before: PositionFix


class RawTracker:
    """Tracker that returns the position of the last measurement, and the velocity between the last two instants.

    Of several measurements at one instant the most precise counts. Nothing is predicted: while measurements are
    missing, the last position stays. Any filter should beat this baseline.
    """

    batched: ClassVar = True

    def step(self, state: RawState | None, scan: Scan) -> tuple[RawState, Estimate]:
        """Store the measurement unless it is older than the latest one; return position and velocity after it."""
        if state is None:
            nowhere = np.full(np.shape(scan.valid), np.nan)
            none = PositionFix(nowhere, Gaussian(np.stack([nowhere] * 2), np.stack([np.stack([nowhere] * 2)] * 2)))
            state = RawState(none, none)
        mean, covariance = SENSOR_MODELS[scan.kind].position(scan)
        is_measured = scan.valid & ~np.isnan(mean[0])
        position = Gaussian(mean, linalg.expand(covariance, mean[None]))
        new = PositionFix(np.where(is_measured, scan.time, np.nan), position)
        is_later = is_measured & ~(state.last.time >= scan.time)
        is_better = is_measured & (state.last.time == scan.time) & (_size(new) < _size(state.last))
        last = _choose(is_later | is_better, new, state.last)
        before = _choose(is_later, state.last, state.before)
        dt = last.time - before.time
        belief, is_complete = two_measurements(before.position, last.position, dt), ~np.isnan(dt)
        estimate = Estimate(*(np.where(is_complete, part, np.nan) for part in belief))
        return RawState(last, before), estimate


def _size(fix: PositionFix) -> Array:
    return np.asarray(fix.position.covariance[0, 0] + fix.position.covariance[1, 1])


def _choose(where: Mask, a: PositionFix, b: PositionFix) -> PositionFix:
    return PositionFix(np.where(where, a.time, b.time), a.position.where(where, b.position))

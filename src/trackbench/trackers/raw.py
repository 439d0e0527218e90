"""The baseline: no filter at all."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.models.sensors import SENSOR_MODELS

#: The published name of the tracker.
BASELINE = "raw"


class PositionFix(NamedTuple):
    """The position that a measurement states."""

    time: Array
    """``(...)`` s, NaN where there is none."""
    mean: Array
    """``(2, ...)`` m."""
    covariance: Array
    """``(2, 2, ...)`` m^2."""


class RawState(NamedTuple):
    """The last two instants at which an object was seen."""

    last: PositionFix
    before: PositionFix


class RawTracker:
    """The last measurement as it is: its position, and the velocity between the last two instants with a measurement.

    Of measurements at one instant the more precise counts. Nothing is predicted: while measurements are missing the
    last position stays, which is what any filter has to beat.
    """

    batched: ClassVar = True

    def step(self, state: RawState | None, scan: Scan) -> tuple[RawState, Estimate]:
        """Keep the measurement, and difference it with the one before; an older one than the latest does not count."""
        if state is None:
            nowhere = np.full(np.shape(scan.valid), np.nan)
            none = PositionFix(nowhere, np.stack([nowhere] * 2), np.stack([np.stack([nowhere] * 2)] * 2))
            state = RawState(none, none)
        mean, covariance = SENSOR_MODELS[scan.kind].position(scan)
        stated = scan.valid & ~np.isnan(mean[0])
        new = PositionFix(np.where(stated, scan.time, np.nan), mean, linalg.expand(covariance, mean[None]))
        later = stated & ~(state.last.time >= scan.time)
        better = stated & (state.last.time == scan.time) & (_size(new) < _size(state.last))
        last = _choose(later | better, new, state.last)
        before = _choose(later, state.last, state.before)
        dt = last.time - before.time
        mean = np.concatenate([last.mean, (last.mean - before.mean) / dt])
        covariance = np.empty((4, *mean.shape))
        covariance[:2, :2] = last.covariance
        covariance[:2, 2:] = covariance[2:, :2] = last.covariance / dt
        covariance[2:, 2:] = (last.covariance + before.covariance) / dt**2
        complete = ~np.isnan(dt)
        covariance = linalg.rounded_up(covariance)
        estimate = Estimate(np.where(complete, mean, np.nan), np.where(complete, covariance, np.nan))
        return RawState(last, before), estimate


def _size(fix: PositionFix) -> Array:
    return np.asarray(fix.covariance[0, 0] + fix.covariance[1, 1])


def _choose(where: Mask, a: PositionFix, b: PositionFix) -> PositionFix:
    return PositionFix(*(np.where(where, x, y) for x, y in zip(a, b, strict=True)))

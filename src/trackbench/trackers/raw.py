"""The baseline: no filter at all."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask, Scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.initial import two_measurements

#: The published name of the tracker.
BASELINE = "raw"


class PositionFix(NamedTuple):
    """The position that a measurement states."""

    time: Array
    """``(...)`` s, NaN where there is none."""
    position: Gaussian
    """``(2, ...)`` m."""


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
            none = PositionFix(nowhere, Gaussian(np.stack([nowhere] * 2), np.stack([np.stack([nowhere] * 2)] * 2)))
            state = RawState(none, none)
        mean, covariance = SENSOR_MODELS[scan.kind].position(scan)
        stated = scan.valid & ~np.isnan(mean[0])
        position = Gaussian(mean, linalg.expand(covariance, mean[None]))
        new = PositionFix(np.where(stated, scan.time, np.nan), position)
        later = stated & ~(state.last.time >= scan.time)
        better = stated & (state.last.time == scan.time) & (_size(new) < _size(state.last))
        last = _choose(later | better, new, state.last)
        before = _choose(later, state.last, state.before)
        dt = last.time - before.time
        belief, complete = two_measurements(before.position, last.position, dt), ~np.isnan(dt)
        estimate = Estimate(*(np.where(complete, part, np.nan) for part in belief))
        return RawState(last, before), estimate


def _size(fix: PositionFix) -> Array:
    return np.asarray(fix.position.covariance[0, 0] + fix.position.covariance[1, 1])


def _choose(where: Mask, a: PositionFix, b: PositionFix) -> PositionFix:
    return PositionFix(np.where(where, a.time, b.time), a.position.where(where, b.position))

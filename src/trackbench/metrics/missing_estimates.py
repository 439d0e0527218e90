"""States charged for missing estimates: the latest measured position without velocity, or the last estimate.

Any tracker could have given the measured position, and a tracker with an earlier estimate could have kept it. The worse
of the two states is charged, so that leaving out a bad estimate never pays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence

import numpy as np

from trackbench.base.types import Array, Mask, Scan
from trackbench.driving.drive import deliveries


def measured_positions(
    scans: Sequence[Scan],
    position: Callable[[int], Array],
    sensors: Collection[str] | None,
    each_measurement: bool = False,
) -> Iterator[Array]:
    """Yield each object's latest measured position at each instant, ``(2, batch)`` m; NaN before its first measurement.

    The sensors that the tracker uses count; before their first measurement of an object, any sensor. Of measurements at
    one instant the later in the order of scans counts.

    Args:
        scans: scans with known objects, in the order in which they were taken.
        position: returns the measured positions ``(2, batch)`` m of the scan with a number, in the fixed frame.
        sensors: names of the sensors that the tracker uses; None for all.
        each_measurement: whether each scan is an instant of its own, as in ``deliveries``.
    """
    every = _held(scans, position, None, each_measurement)
    if sensors is None:
        return every
    return (
        np.where(np.isnan(used), any_sensor, used)
        for any_sensor, used in zip(every, _held(scans, position, sensors, each_measurement), strict=True)
    )


def _held(
    scans: Sequence[Scan], position: Callable[[int], Array], sensors: Collection[str] | None, each_measurement: bool
) -> Iterator[Array]:
    latest, taken = np.full((2, scans[0].valid.size), np.nan), np.full(scans[0].valid.size, -np.inf)
    for delivered in deliveries(scans, each_measurement=each_measurement):
        for delivery in delivered:
            scan = delivery.scan
            if delivery.number is not None and (sensors is None or scan.sensor in sensors):
                measured = position(delivery.number)
                newer = scan.valid & (scan.time >= taken) & ~np.isnan(measured[0])
                latest = np.where(newer, measured, latest)
                taken = np.where(newer, scan.time, taken)
        yield latest


class ChargedEstimates:
    """Replacement of a tracker's missing estimates by charged states, for some instants at a time, in order."""

    def __init__(self, state: Array, expected: Mask, measured: Callable[[slice], Array] | None) -> None:
        """Prepare for the first instant.

        Args:
            state: ``(4, instants, objects, runs or 1)`` the truth.
            expected: ``(instants, objects, runs)`` where the object is in view; an object that comes back into view
                counts as a new object.
            measured: returns the :func:`measured_positions` at some instants, ``(2, instants, objects * runs)`` m;
                needed where an estimate is missing.
        """
        self._state, self._expected, self._measured = state, expected, measured
        self._latest = np.full((4, math.prod(expected.shape[1:])), np.nan)

    def note(self, mean: Array, instant: int) -> None:
        """Keep the estimates ``(4, batch)`` of an instant at which no expected estimate is missing."""
        self._latest = np.where(self._expected[instant].reshape(-1), mean, np.nan)

    def charge(self, mean: Array, given: Mask, instants: slice) -> None:
        """Replace expected estimates that are missing by charged states, in place.

        Args:
            mean: ``(4, instants, batch)`` estimates.
            given: ``(instants, batch)`` where the tracker gave an estimate.
            instants: slice of the instants of these estimates.
        """
        expected = self._expected[instants].reshape(given.shape)
        if given[expected].all():
            self.note(mean[:, -1], instants.stop - 1)
            return
        held = held_estimates(self._latest, mean, given, expected)
        self._latest = held[:, -1]
        missing = expected & ~given
        assert self._measured is not None
        truth = np.broadcast_to(self._state[:, instants], (4, *self._expected[instants].shape)).reshape(4, *given.shape)
        mean[:, missing] = charged_states(truth[:, missing], self._measured(instants)[:, missing], held[:, missing])


def held_estimates(latest: Array, mean: Array, given: Mask, expected: Mask) -> Array:
    """Return each object's latest given estimate at each instant, ``(4, instants, batch)``; NaN if none was given yet.

    Args:
        latest: ``(4, batch)`` latest estimates before these instants.
        mean: ``(4, instants, batch)`` estimates at these instants.
        given: ``(instants, batch)`` where the tracker gave an estimate.
        expected: ``(instants, batch)`` where the object is in view.
    """
    every = np.concatenate([latest[:, None], np.where(expected, mean, np.nan)], axis=1)
    number = np.where(given | ~expected, np.arange(1, len(given) + 1)[:, None], 0)
    return np.take_along_axis(every, np.maximum.accumulate(number)[None], axis=1)


def charged_states(truth: Array, measured: Array, held: Array) -> Array:
    """Return the states charged for missing estimates, ``(4, n)``: the worse position and the worse velocity.

    Args:
        truth: ``(4, n)`` true states.
        measured: ``(2, n)`` the latest measured position, m.
        held: ``(4, n)`` the tracker's latest estimate; NaN where it gave none before.
    """
    at_rest = np.concatenate([measured, np.zeros_like(measured)])
    held_error, error = ((state - truth) ** 2 for state in (held, at_rest))
    # False where the held estimate is NaN.
    is_worse = [held_error[row] + held_error[row + 1] > error[row] + error[row + 1] for row in (0, 2)]
    return np.where(np.repeat(is_worse, 2, axis=0), held, at_rest)

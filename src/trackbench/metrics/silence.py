"""What a tracker is charged with where it gave no estimate that was due: no more than anyone could have said.

That is the latest measured position and no velocity. A tracker that gave an estimate before could have left that
standing; it is charged with the worse of the two, so that leaving out a bad estimate never pays.
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
    """At each instant ``(2, batch)`` m, the position that the latest measurement of each object states, held until the
    next one arrives: of the sensors that a tracker reads, before their first measurement of it that of any sensor.

    NaN before that. Of measurements at one instant the later in the order of scans counts.

    Args:
        scans: of known objects, in the order in which they were taken.
        position: gives ``(2, batch)`` m in the fixed frame of the scan of a number.
        sensors: names of those that the tracker reads; None: all.
        each_measurement: whether each scan is an instant of its own, as of ``deliveries``.
    """
    every = _held(scans, position, None, each_measurement)
    if sensors is None:
        return every
    return (
        np.where(np.isnan(read), any_sensor, read)
        for any_sensor, read in zip(every, _held(scans, position, sensors, each_measurement), strict=True)
    )


def _held(
    scans: Sequence[Scan], position: Callable[[int], Array], sensors: Collection[str] | None, each_measurement: bool
) -> Iterator[Array]:
    latest, taken = np.full((2, scans[0].valid.size), np.nan), np.full(scans[0].valid.size, -np.inf)
    for delivered in deliveries(scans, each_measurement=each_measurement):
        for scan, number, _ in delivered:
            if number is not None and (sensors is None or scan.sensor in sensors):
                stated = position(number)
                newer = scan.valid & (scan.time >= taken) & ~np.isnan(stated[0])
                latest = np.where(newer, stated, latest)
                taken = np.where(newer, scan.time, taken)
        yield latest


class Silence:
    """Puts what a tracker is charged with in the place of its missing estimates, some instants at a time, in order."""

    def __init__(self, state: Array, expected: Mask, measured: Callable[[slice], Array] | None) -> None:
        """Before the first instant.

        Args:
            state: ``(4, instants, objects, runs or 1)`` the truth.
            expected: ``(instants, objects, runs)`` where the object is in view; one that comes back later counts as a
                new one.
            measured: gives ``(2, instants, objects * runs)`` m of :func:`measured_positions` at some instants; needed
                where an estimate is missing.
        """
        self._state, self._expected, self._measured = state, expected, measured
        self._latest = np.full((4, math.prod(expected.shape[1:])), np.nan)

    def note(self, mean: Array, instant: int) -> None:
        """Note the estimates ``(4, batch)`` of an instant at which all that are expected were given."""
        self._latest = np.where(self._expected[instant].reshape(-1), mean, np.nan)

    def charge(self, mean: Array, given: Mask, here: slice) -> None:
        """Change ``(4, instants, batch)`` estimates in place where they are expected and not given.

        Args:
            mean: the estimates.
            given: ``(instants, batch)`` where there is one.
            here: which instants they are.
        """
        expected = self._expected[here].reshape(given.shape)
        if given[expected].all():
            self.note(mean[:, -1], here.stop - 1)
            return
        own = own_estimates(self._latest, mean, given, expected)
        self._latest = own[:, -1]
        missing = expected & ~given
        assert self._measured is not None
        truth = np.broadcast_to(self._state[:, here], (4, *self._expected[here].shape)).reshape(4, *given.shape)
        mean[:, missing] = charged_states(truth[:, missing], self._measured(here)[:, missing], own[:, missing])


def own_estimates(latest: Array, mean: Array, given: Mask, expected: Mask) -> Array:
    """``(4, instants, batch)`` the latest estimate that was given of each object, held; NaN before the first.

    Args:
        latest: ``(4, batch)`` before the first of these instants.
        mean: ``(4, instants, batch)``.
        given: ``(instants, batch)``.
        expected: ``(instants, batch)``
    """
    every = np.concatenate([latest[:, None], np.where(expected, mean, np.nan)], axis=1)
    number = np.where(given | ~expected, np.arange(1, len(given) + 1)[:, None], 0)
    return np.take_along_axis(every, np.maximum.accumulate(number)[None], axis=1)


def charged_states(truth: Array, measured: Array, own: Array) -> Array:
    """``(4, n)`` the state that stands for an estimate that is missing: of position and of velocity each the worse.

    Args:
        truth: ``(4, n)``.
        measured: ``(2, n)`` the latest measured position, m.
        own: ``(4, n)`` the tracker's latest own estimate; NaN where it gave none before.
    """
    anyone = np.concatenate([measured, np.zeros_like(measured)])
    own_error, error = ((state - truth) ** 2 for state in (own, anyone))
    # Not true of NaN.
    worse = [own_error[row] + own_error[row + 1] > error[row] + error[row + 1] for row in (0, 2)]
    return np.where(np.repeat(worse, 2, axis=0), own, anyone)

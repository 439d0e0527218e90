"""Members of a tracker that draws random numbers, each driven again alone: its errors must have the same law.

Estimates that are drawn anew cannot be compared one by one. But a member that is alone has what it has in its batch, so
that the error in the batch has any rank among those of drives alone with the same probability. One that reads other
members is better, or worse, in the batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Tracks
from trackbench.driving.again import Disagreement, StepTaken, answer_of_columns, scan_of_columns
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Stepper

#: Members that are driven again, at most and at least, and how many copies of itself each has for company: so its draws
#: are not those of every other member, also where the tracker fixes its seed.
MOST, FEWEST, COPIES = 20, 10, 4
#: Largest probability of a wrong word on a tracker whose members are independent.
LEVEL = 1e-4
#: Squared errors that differ by a smaller factor are not spoken of: draws that all members share may make it.
LEAST_FACTOR = 1.25
#: Squared distances below this are none, m^2.
SMALLEST = 1e-24


class MembersAlone:
    """The second drive of a tracker that draws random numbers: some members, each of them alone.

    Args:
        start: gives a fresh tracker for ``COPIES`` members.
        members: ``(n,)`` their columns in the first drive.
        time: ``(instants,)`` s.
        truth: ``(2, instants, objects, n)`` m, where their objects are; NaN where one is not there.
        farthest: distance that counts where no estimate is nearer, m; infinite: such instants are left out.
    """

    def __init__(
        self, start: Callable[[], Stepper], members: Indices, time: Array, truth: Array, farthest: float
    ) -> None:
        self._start, self.members, self._time, self._truth, self._farthest = start, members, time, truth, farthest

    def disagreement(self, steps: Sequence[StepTaken]) -> Disagreement | None:
        """Drive each member alone, one after the other; return what differs in law."""
        alone, scan = [], steps[0].scan
        for place, member in enumerate(self.members):
            truth = np.repeat(self._truth[..., place, None], COPIES, axis=-1)
            copies, own = np.full(COPIES, member), []
            try:
                with closing(self._start()) as stepper:
                    for scan, _ in steps:
                        answer = stepper.step(scan_of_columns(scan, copies))
                        own.append(StepTaken(scan, answer_of_columns(answer, np.arange(COPIES))))
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                fault = fault_of(error)
                cause = f"driven again with one member alone, it fails: {fault.cause}"
                return Disagreement(TrackFault(cause, fault.kind, fault.place, int(member)), scan)
            alone.append(self._mean_log(own, truth))
        difference = difference_in_law(self._mean_log(steps, self._truth), np.array(alone))
        return Disagreement(TrackFault(difference, "answer"), scan) if difference else None

    def _mean_log(self, steps: Sequence[StepTaken], truth: Array) -> Array:
        """``(n,)`` mean logarithm of the squared errors at all instants; 0 of none."""
        latest: dict[int, Array] = {}
        for scan, answer in steps:
            # A scan that is late is no answer to its own instant.
            if scan.arrival_time <= scan.time + SAME_TIME:
                instant = int(np.searchsorted(self._time, scan.time - SAME_TIME))
                latest[instant] = self._errors(answer, truth[:, instant])
        logs = np.log(np.maximum(list(latest.values()), SMALLEST))
        there = np.isfinite(logs)
        return np.asarray(np.where(there, logs, 0.0).sum(axis=(0, 1)) / np.maximum(there.sum(axis=(0, 1)), 1))

    def _errors(self, answer: Any, truth: Array) -> Array:
        """``(objects, n)`` squared distances of objects ``(2, objects, n)`` from the nearest estimate, m^2."""
        if answer is None:
            mean = np.full((2, 1, truth.shape[-1]), np.nan)
        elif isinstance(answer, Tracks):
            mean = np.where(answer.ids >= 0, answer.mean[:2], np.nan)
        else:
            mean = answer.mean[:2, None]
        squares = ((mean[:, :, None] - truth[:, None]) ** 2).sum(axis=0)
        nearest = np.fmin.reduce(squares, axis=0, initial=self._farthest**2)
        return np.where(np.isfinite(truth[0]) & np.isfinite(nearest), nearest, np.nan)


def difference_in_law(batch: Array, alone: Array) -> str:
    """Say that members err otherwise in a batch than alone, and by how much; empty where nothing shows it.

    A rank among distinct drives alone, scaled to -1 to 1, has the variance ``(k + 2) / 3k``, and no larger moment
    generating function than a normal variable of this variance. So Chernoff's bound holds for the sum of the ranks.

    Args:
        batch: ``(n,)`` mean logarithm of the squared error of each member in the batch.
        alone: ``(n, k)`` the same of drives alone.
    """
    distinct = [np.unique(row) for row in alone]
    ranks = [np.sign(own - each).mean() for own, each in zip(batch, distinct, strict=True)]
    variance = sum((len(each) + 2) / (3 * len(each)) for each in distinct)
    p_value = 2 * math.exp(-(sum(ranks) ** 2) / (2 * variance))
    factor = math.exp(float(np.mean(alone.mean(axis=1) - batch)))
    if p_value >= LEVEL or 1 / LEAST_FACTOR < factor < LEAST_FACTOR:
        return ""
    compared = f"of {len(batch)} members driven again, each alone, the squared errors are {factor:.3g} times as large"
    return f"{compared} (p < {LEVEL:g}): they depend on the other members; likely an operation over the batch"

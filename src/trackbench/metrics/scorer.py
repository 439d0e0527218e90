"""Scores a tracker's estimates as they come, several instants at a time so that NumPy's calls are few."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.metrics.breakdown import class_sums
from trackbench.metrics.conditions import Classes
from trackbench.metrics.consistency import normalised_square, whitened_innovation
from trackbench.metrics.innovations import Innovations
from trackbench.metrics.scores import ERROR_FIELDS, OVERFLOW, Scores
from trackbench.trackers.answers import NOT_DEFINITE, NOT_FINITE, TOO_LARGE
from trackbench.types import Array, Estimate, Mask, Scan
from trackbench.units import wrap_angle

#: Below this true speed the course means nothing, m/s.
MOVING = 1.0
#: Smallest share of the product of its variances that the determinant of a 2 by 2 covariance is taken for: rounding.
SMALLEST_DETERMINANT = 1e-14
#: Numbers of batch and instants whose product makes one batch of scoring: large enough that NumPy's calls are few.
BATCH = 8000


class Target(NamedTuple):
    """What the estimates of a block of runs are held against, at each instant of a scan."""

    time: Array
    """``(instants,)`` s."""
    state: Array
    """``(4, instants, objects, runs or 1)`` px, py, vx, vy."""
    alive: Mask
    """``(instants, objects)``"""
    start: Array
    """``(objects, runs)`` from when each track is scored, s; infinity where the object was never detected."""
    divergence: float
    """m"""


class Fault(Exception):
    """An estimate that cannot be scored."""

    def __init__(self, cause: str, instant: int, member: int) -> None:
        super().__init__(cause)
        self.cause = cause
        self.instant = instant
        self.member = member


class Scorer:
    """Collects the estimates of one tracker on one block of runs; ``scores`` gives the sums at the end."""

    def __init__(self, target: Target, classes: Classes, measurements: dict[str, int], keep_spread: bool) -> None:
        """A scorer of one block.

        Args:
            target: what the estimates are held against.
            classes: ``(instants, objects, runs or 1)`` of :func:`trackbench.metrics.conditions.conditions`.
            measurements: how many instants each sensor has.
            keep_spread: whether percentiles are wanted.
        """
        self._target = target
        _, self._instants, self._objects, _ = target.state.shape
        self._runs = target.start.shape[1]
        self._batch = self._objects * self._runs
        self._chunk = max(1, BATCH // self._batch)
        self._mean = np.empty((4, self._chunk, self._batch))
        self._covariance = np.empty((4, 4, self._chunk, self._batch))
        self._first = self._filled = 0
        self._seen = np.zeros(self._batch, dtype=bool)
        self._expected = (target.alive[:, :, None] & (target.time[:, None, None] >= target.start)).reshape(
            self._instants, self._batch
        )
        self._per_step = np.zeros((len(ERROR_FIELDS), self._instants))
        self._found, found = np.unique(classes, return_inverse=True)
        self._class = found.reshape(classes.shape)
        self._per_class = np.zeros((len(ERROR_FIELDS), len(self._found), self._runs))
        self._weight = np.zeros((self._instants, self._objects))
        self._diverged = np.zeros(self._runs, dtype=bool)
        self._repaired = np.zeros(self._runs)
        self._spread = np.full((2, self._instants), np.nan)
        self._keep_spread = keep_spread
        self._innovations = {
            name: Innovations(count, self._objects, self._runs, self._chunk) for name, count in measurements.items()
        }

    def innovation(self, instant: int, scan: Scan, estimate: Estimate) -> None:
        """Take in what a scan said; to be called for every scan, in order."""
        self._innovations[scan.sensor].add(whitened_innovation(estimate), scan.valid & self._expected[instant])
        if estimate.repaired is not None:
            self._repaired += self._by_run(estimate.repaired & self._expected[instant])

    def estimate(self, estimate: Estimate) -> None:
        """Take in the estimate after the last scan of an instant.

        Raises:
            Fault: an estimate is not finite or its covariance not positive definite.
        """
        self._mean[:, self._filled] = estimate.mean
        self._covariance[:, :, self._filled] = estimate.covariance
        self._filled += 1
        if self._filled == self._chunk:
            self._flush()

    def scores(self, seconds: float, steps: int) -> Scores:
        """The sums of everything taken in."""
        self._flush()
        return Scores(
            per_step=self._per_step,
            per_run=self._per_class.sum(axis=1),
            weight=self._weight,
            present=self._by_run(self._expected.sum(axis=0)),
            diverged=self._diverged.astype(float),
            repaired=self._repaired,
            nis={name: item.scores() for name, item in self._innovations.items()},
            classes=class_sums(self._per_class, self._found),
            spread=self._spread,
            seconds=seconds,
            steps=steps,
        )

    def _by_run(self, batch: Array) -> Array:
        """``(..., runs)`` sums over the objects of values ``(..., batch)``."""
        return np.asarray(batch.reshape(*batch.shape[:-1], self._objects, self._runs).sum(axis=-2))

    def _alive(self, instants: slice) -> Mask:
        """``(instants, batch)``"""
        return np.repeat(self._target.alive[instants], self._runs, axis=1)

    def _flush(self) -> None:
        filled, first = self._filled, self._first
        if filled == 0:
            return
        self._filled, self._first = 0, first + filled
        here = slice(first, first + filled)
        mean, covariance = self._mean[:, :filled], self._covariance[:, :, :filled]
        # A sum is finite only if all of its terms are; a covariance with finite variances and other entries that are
        # not is not positive definite.
        total = mean.sum(axis=0) + np.einsum("ii...->...", covariance)
        finite = np.isfinite(total)
        if finite.all():
            self._seen[:] = True
        else:
            # NaN from the start means that there is no estimate yet.
            seen = self._seen | np.logical_or.accumulate(~np.isnan(total), axis=0)
            self._seen = seen[-1]
            self._reject(NOT_FINITE, self._alive(here) & seen & ~finite)

        shape = (filled, self._objects, self._runs)
        truth = self._target.state[:, here]
        values = np.empty((len(ERROR_FIELDS), filled, self._batch))
        error = values[1:5]
        np.subtract(mean.reshape(4, *shape), truth, out=error.reshape(4, *shape))
        nees, white, positive = normalised_square(error, covariance)
        if not positive.all():
            self._reject(NOT_DEFINITE, self._alive(here) & finite & ~positive)

        scored = self._expected[here] & finite
        vx, vy = truth[2], truth[3]
        moving = scored & np.broadcast_to(vx * vx + vy * vy > MOVING**2, shape).reshape(scored.shape)
        true_course = np.arctan2(vy, vx)
        course = wrap_angle(np.arctan2(mean[3], mean[2]).reshape(shape) - true_course).reshape(scored.shape)
        values[0] = 1.0
        with np.errstate(all="ignore"):
            # The first two whitened components are those of the position by itself.
            values[8] = white[0] * white[0] + white[1] * white[1]
            product = error[2] * error[3]
            error *= error
            values[9] = _nees_of_velocity(error, product, covariance)
        values[5] = nees
        values[6] = moving
        np.multiply(course, course, out=values[7])
        if not scored.all():
            np.copyto(values, 0.0, where=~scored)
        np.copyto(values[7], 0.0, where=~moving)
        if not values.max() < OVERFLOW:
            self._reject(TOO_LARGE, ~(values.max(axis=0) < OVERFLOW))
        self._per_step[:, here] = values @ np.ones(self._batch)
        self._add_by_class(values, self._class[here])
        self._weight[here] = values[0].reshape(shape).sum(axis=2)
        square = values[1] + values[2]
        self._diverged |= self._by_run((square > self._target.divergence**2).any(axis=0)) > 0
        if self._keep_spread:
            self._spread[:, here] = percentiles((0.1, 0.9), np.sqrt(square), scored)

    def _add_by_class(self, values: Array, classes: npt.NDArray[np.intp]) -> None:
        """Add values ``(fields, instants, batch)`` to the sums of their classes ``(instants, objects, runs or 1)``."""
        present = np.flatnonzero(np.bincount(classes.reshape(-1)))
        if classes.shape[-1] == 1:
            member = (present[:, None] == classes.reshape(-1)).astype(float)
            self._per_class[:, present] += member @ values.reshape(len(values), -1, self._runs)
            return
        places = (classes * self._runs + np.arange(self._runs)).reshape(-1)
        for total, value in zip(self._per_class, values, strict=True):
            total += np.bincount(places, value.reshape(-1), total.size).reshape(total.shape)

    def _reject(self, cause: str, wrong: Mask) -> None:
        if np.any(wrong):
            step, member = np.argwhere(wrong)[0]
            raise Fault(cause, self._first - len(wrong) + int(step), int(member))


def _nees_of_velocity(squares: Array, product: Array, covariance: Array) -> Array:
    """That of the last two of four components, of which ``product`` is the product of the errors, by themselves."""
    a, b, d = covariance[2, 2], covariance[3, 2], covariance[3, 3]
    variances = a * d
    determinant = np.maximum(variances - b * b, SMALLEST_DETERMINANT * variances)
    return np.asarray((d * squares[2] + a * squares[3] - 2.0 * (b * product)) / determinant)


def percentiles(shares: tuple[float, ...], values: Array, use: Mask) -> Array:
    """``(shares, steps)`` values below which each share of those in use lies, interpolated; NaN where none is.

    Args:
        shares: 0 to 1.
        values: ``(steps, batch)``.
        use: ``(steps, batch)``.
    """
    rank = np.asarray(shares)[:, None] * np.maximum(use.sum(axis=1) - 1, 0)
    ends = np.stack([np.floor(rank), np.ceil(rank)]).astype(int)
    ordered = np.sort(values if use.all() else np.where(use, values, np.nan), axis=1)
    low, high = ordered[np.arange(len(ordered)), ends]
    return np.asarray(low + (rank % 1.0) * (high - low))

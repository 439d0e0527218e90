"""Correction of the present belief by a late measurement, without processing later ones again."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.base.units import difference
from trackbench.filters import Belief, SingleModelFilter, Update
from trackbench.filters.base import correct, guarded
from trackbench.models.motion import MotionModel, process_noise_covariance


class Retrodiction(NamedTuple):
    """What a filter believed before a late measurement was taken, and believes now."""

    before: Belief
    """After the latest scan that was taken before it."""
    time: float
    """Of that scan, s."""
    now: Belief
    times: tuple[float, ...]
    """Of all scans that were taken since the late one; the last is that of ``now``, s."""


def retrodicted(filter: SingleModelFilter, beliefs: Retrodiction, scan: Scan) -> Update[Belief]:
    """The present belief with a late measurement, without taking later ones in again.

    All measurements since ``beliefs.before`` count as one equivalent measurement at the present, which the two beliefs
    tell; with it the state and the process noise go back to the late measurement's time. With one measurement in
    between and a linear model this is the optimal algorithm A1, with more Al1, which is nearly so. The process noise is
    that of the steps between the measurements. A nonlinear model is linearised at the present mean, and its transition
    taken over a negative time.

    Source: Bar-Shalom (2002), "Update with out-of-sequence measurements in tracking: exact solution", equations 18 to
    35; Bar-Shalom, Chen and Mallick (2004), "One-step solution for the multistep out-of-sequence-measurement problem in
    tracking", section III.
    """
    motion, now = filter.motion, beliefs.now
    back = beliefs.times[-1] - scan.time
    ahead = beliefs.before
    for start, end in pairwise((beliefs.time, *beliefs.times)):
        ahead = filter.predict(Belief(ahead.mean, ahead.covariance), end - start)
    gained = difference(now.mean, ahead.mean, motion.angular)
    inverse = _inverse(ahead.covariance)
    # What the equivalent measurement says: its information, and with it its innovation.
    information = linalg.matmul(linalg.matmul(inverse, ahead.covariance - now.covariance), inverse)
    noise = _noise(motion, now, (scan.time, *beliefs.times))
    pushed = linalg.apply(linalg.matmul(noise, inverse), gained)
    noise_covariance = noise - linalg.quadratic(noise, information)
    shared = noise - linalg.matmul(linalg.matmul(ahead.covariance, information), noise)
    f = np.broadcast_to(linalg.expand(motion.jacobian(now.mean, -back), now.covariance), now.covariance.shape)
    with_past = linalg.matmul_transposed(now.covariance - shared, f)
    spread = now.covariance + noise_covariance - shared - np.swapaxes(shared, 0, 1)
    past = guarded(Belief(motion.transition(now.mean - pushed, -back), linalg.symmetrise(linalg.quadratic(f, spread))))
    expected, measured = filter.predict_measurement(past, scan), filter.measured(scan)
    # Of the present state: the measurement's cross covariance with the past one, carried there.
    slope = linalg.matmul(expected.cross, _inverse(past.covariance))
    cross = linalg.matmul_transposed(slope, with_past)
    innovation = difference(measured.value, expected.mean, measured.angular)
    s = expected.covariance + linalg.expand(measured.noise, expected.covariance)
    update = correct(now._replace(points=None, factor=None), innovation, s, cross, scan.valid, motion.angular)
    return update._replace(belief=guarded(update.belief))


def _noise(motion: MotionModel, now: Belief, times: tuple[float, ...]) -> Array:
    """``(n, n, ...)`` covariance of the process noise between these times, s, in the state at the last of them."""
    noise = np.zeros_like(now.covariance)
    for start, end in pairwise(times):
        mean = motion.transition(now.mean, start - times[-1])
        added = process_noise_covariance(motion, mean, end - start)
        f = linalg.expand(motion.jacobian(mean, end - start), noise)
        noise = linalg.quadratic(np.broadcast_to(f, noise.shape), noise) + linalg.expand(added, noise)
    return noise


def _inverse(p: Array) -> Array:
    """The inverse of a covariance ``(n, n, ...)``."""
    identity = np.broadcast_to(linalg.expand(np.eye(len(p)), p), p.shape)
    return linalg.gram(linalg.ensure_definite(p).factor.whiten(identity))

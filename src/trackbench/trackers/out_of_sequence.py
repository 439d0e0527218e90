"""The answer of a tracker with a built-in filter to a late scan, by replay or by retrodiction."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Scan
from trackbench.base.units import difference
from trackbench.filters import Belief, SingleModelFilter, Update
from trackbench.filters.base import correct, guarded
from trackbench.models.motion import MotionModel, process_noise
from trackbench.trackers.estimates import total_log_likelihood, with_innovation
from trackbench.trackers.in_order import InOrder, TrackState
from trackbench.trackers.late import inserted, replayed, up_to_date


def after_replay(tracker: InOrder, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
    """The state with a late scan at this index of its history, and the present estimate with that scan's innovation."""
    again = replayed(tracker.step, state.history, number, scan)
    late = again.late
    gained = total_log_likelihood(again.history[number:]) - total_log_likelihood(state.history[number:])
    return again.state._replace(history=again.history), again.latest._replace(
        innovation=late.innovation,
        innovation_covariance=late.innovation_covariance,
        whitened_innovation=late.whitened_innovation,
        # Of the late scan given all that were processed before. Zero: no track was there for any of them.
        log_likelihood=np.where(gained == 0.0, np.nan, gained),
    )


def after_retrodiction(tracker: InOrder, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
    """The present state and estimate corrected by a late scan, where a track has gone on since before it."""
    history = up_to_date(tracker.step, state.history, number)
    before = history[number].before
    known = before.started & state.started
    part = scan._replace(valid=known & scan.valid)
    if before.fallback is not None or state.fallback is not None or not np.any(part.valid):
        return state._replace(history=history), tracker.estimate(state)
    assert isinstance(tracker.filter, SingleModelFilter)
    assert isinstance(before.belief, Belief)
    assert isinstance(state.belief, Belief)
    times = tuple(processed.scan.time for processed in history[number:])
    update = retrodicted(tracker.filter, Retrodiction(before.belief, before.time, state.belief, times), part)
    after = state._replace(belief=update.belief)
    estimate = with_innovation(tracker.estimate(after), update, known)
    history = inserted(history, number, part)
    return after._replace(belief=update.belief._replace(repaired=None), history=history), estimate


class Retrodiction(NamedTuple):
    """What a filter believed before a late measurement was taken, and believes now."""

    before: Belief
    """After the latest scan that was taken before it."""
    time: float
    """Of that scan, s."""
    now: Belief
    times: tuple[float, ...]
    """Of all scans that were taken since the late one; the last is that of ``now``, s."""


def retrodicted(filter: SingleModelFilter, known: Retrodiction, scan: Scan) -> Update[Belief]:
    """The present belief with a late measurement, without taking later ones in again.

    All measurements since ``known.before`` count as one equivalent measurement at the present, which the two beliefs
    tell; with it the state and the process noise go back to the late measurement's time. With one measurement in
    between and a linear model this is the optimal algorithm A1, with more Al1, which is nearly so. The process noise is
    that of the steps between the measurements. A nonlinear model is linearised at the present mean, and its transition
    taken over a negative time.

    Source: Bar-Shalom (2002), "Update with out-of-sequence measurements in tracking: exact solution", equations 18 to
    35; Bar-Shalom, Chen and Mallick (2004), "One-step solution for the multistep out-of-sequence-measurement problem in
    tracking", section III.
    """
    motion, now = filter.motion, known.now
    back = known.times[-1] - scan.time
    ahead = known.before
    for start, end in pairwise((known.time, *known.times)):
        ahead = filter.predict(Belief(ahead.mean, ahead.covariance), end - start)
    gained = difference(now.mean, ahead.mean, motion.angular)
    inverse = _inverse(ahead.covariance)
    # What the equivalent measurement says: its information, and with it its innovation.
    information = linalg.matmul(linalg.matmul(inverse, ahead.covariance - now.covariance), inverse)
    noise = _noise(motion, now, (scan.time, *known.times))
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
        added = process_noise(motion, mean, end - start)
        f = linalg.expand(motion.jacobian(mean, end - start), noise)
        noise = linalg.quadratic(np.broadcast_to(f, noise.shape), noise) + linalg.expand(added, noise)
    return noise


def _inverse(p: Array) -> Array:
    """The inverse of a covariance ``(n, n, ...)``."""
    identity = np.broadcast_to(linalg.expand(np.eye(len(p)), p), p.shape)
    return linalg.gram(linalg.ensure_definite(p).factor.whiten(identity))

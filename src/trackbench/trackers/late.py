"""Scans that are older than what a tracker has already taken in: out-of-sequence measurements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from trackbench import linalg
from trackbench.filters import Belief, SingleModelFilter, Update
from trackbench.filters.base import correct, guarded
from trackbench.models.motion import process_noise
from trackbench.types import Array, Indices, Mask, Scan
from trackbench.units import difference

LateMethod = Literal["drop", "as_new", "replay", "retrodiction"]


class Timed(Protocol):
    """A state that knows when it is of."""

    @property
    def time(self) -> float:
        """Of the latest scan that was taken in, s."""
        ...


S = TypeVar("S", bound=Timed)
A = TypeVar("A")


class Taken(NamedTuple, Generic[S]):
    """A scan that was taken in."""

    before: S
    """The state before it."""
    scan: Scan
    origins: Indices | None = None
    """Of its detections, for the tracker that knows them."""


class Replayed(NamedTuple, Generic[S, A]):
    """What going back to a late scan's time and taking all later scans in again gave."""

    state: S
    late: A
    """What the tracker said after the late scan."""
    latest: A
    """What it said after the latest scan."""
    history: tuple[Taken[S], ...]


def kept(history: tuple[Taken[S], ...], taken: Taken[S], lag: float) -> tuple[Taken[S], ...]:
    """The history with one more scan, and without those that are older than it by more than ``lag`` seconds."""
    if lag == 0.0:
        return ()
    return (*(one for one in history if one.scan.time >= taken.scan.time - lag), taken)


def since(history: tuple[Taken[S], ...], time: float) -> tuple[Taken[S], ...]:
    """What was taken in of scans after that time; nothing where the history does not reach back so far."""
    later = tuple(one for one in history if one.scan.time > time)
    return later if later and later[0].before.time <= time else ()


def replayed(
    step: Callable[[S, Scan, Indices | None], tuple[S, A]],
    history: tuple[Taken[S], ...],
    later: tuple[Taken[S], ...],
    scan: Scan,
    origins: Indices | None = None,
) -> Replayed[S, A]:
    """Take a late scan in at its time, and the later ones of the history again.

    Scans of one time stay in the order in which they arrived.
    """
    state = later[0].before
    redone = [Taken(state, scan, origins)]
    state, late = step(state, scan, origins)
    latest = late
    for one in later:
        redone.append(Taken(state, one.scan, one.origins))
        state, latest = step(state, one.scan, one.origins)
    return Replayed(state, late, latest, (*history[: len(history) - len(later)], *redone))


class Retrodiction(NamedTuple):
    """What a filter believed before a late measurement was taken, and believes now."""

    before: Belief
    """After the latest scan that was taken before it."""
    time: float
    """Of that scan, s."""
    now: Belief
    now_time: float
    """s"""


def retrodicted(filter: SingleModelFilter, known: Retrodiction, scan: Scan, valid: Mask) -> Update[Belief]:
    """The present belief with a late measurement, without taking later ones in again.

    All measurements since ``known.before`` count as one equivalent measurement at the present, which the two beliefs
    tell; with it the state and the process noise go back to the late measurement's time. With one measurement in
    between and a linear model this is the optimal algorithm A1, with more Al1, which is nearly so. A nonlinear model is
    linearised at the present mean, and its transition taken over a negative time.

    Source: Bar-Shalom (2002), "Update with out-of-sequence measurements in tracking: exact solution", equations 18 to
    35; Bar-Shalom, Chen and Mallick (2004), "One-step solution for the multistep out-of-sequence-measurement problem in
    tracking", section III.
    """
    motion, now = filter.motion, known.now
    back = known.now_time - scan.time
    ahead = filter.predict(known.before, known.now_time - known.time)
    gained = difference(now.mean, ahead.mean, motion.angular)
    inverse = _inverse(ahead.covariance)
    # What the equivalent measurement says: its information, and with it its innovation.
    information = linalg.matmul(linalg.matmul(inverse, ahead.covariance - now.covariance), inverse)
    noise = process_noise(motion, motion.transition(now.mean, -back), back)
    noise = np.broadcast_to(linalg.expand(noise, now.covariance), now.covariance.shape)
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
    update = correct(now._replace(points=None, factor=None), innovation, s, cross, valid, motion.angular)
    return update._replace(belief=guarded(update.belief))


def _inverse(p: Array) -> Array:
    """The inverse of a covariance ``(n, n, ...)``."""
    identity = np.broadcast_to(linalg.expand(np.eye(len(p)), p), p.shape)
    return linalg.gram(linalg.ensure_definite(p).factor.whiten(identity))

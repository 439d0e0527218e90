"""Objects and tracks that T-GOSPA may assign to each other, and what is plain without solving anything."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.instants import last_instant


class ObjectTrackPairs(NamedTuple):
    """Pairs ``(E,)`` of an object and a track that are near each other at some instant."""

    object: Indices
    track: Indices
    gain: Array
    """``(T, E)`` what it saves to have them assigned to each other."""


class Presolved(NamedTuple):
    """What is the same in every optimum, ``(T, E)`` each; what is in neither is not assigned."""

    assigned: Mask
    open: Mask
    """To be decided."""


def presolve(pairs: ObjectTrackPairs, half: float) -> Presolved:
    """The pairs that every optimum assigns at an instant.

    A pair has an advantage where it gains more than the best other pairs of its object and of its track together.
    Take a stretch of instants without a disadvantage. To assign the pair from its start, or up to its end, costs at
    most three changes there: it begins or ends, and its object and its track each leave or take another. So it is
    assigned at every instant up to which, and after which, its advantages in the stretch sum to more. Where the run
    begins and ends, there is no such cost.

    Args:
        pairs: with a gain of 0 or more.
        half: cost of a change.
    """
    advantage = pairs.gain - _rivals(pairs.gain, pairs.object) - _rivals(pairs.gain, pairs.track)
    enough = (_since(advantage) > 3 * half) & (_since(advantage[::-1])[::-1] - advantage > 3 * half)
    assigned = enough & (advantage > 0)
    excluded = np.zeros_like(assigned)
    for owner in (pairs.object, pairs.track):
        for own in _columns_of(owner):
            excluded[:, own] |= assigned[:, own].any(axis=1, keepdims=True)
    return Presolved(assigned, ~excluded)


def _since(advantage: Array) -> Array:
    """Sum since the last disadvantage; infinite where there was none before."""
    total = np.cumsum(advantage, axis=0)
    last = last_instant(advantage < 0)
    return np.where(last < 0, np.inf, total - np.take_along_axis(total, np.maximum(last, 0), axis=0))


def _rivals(gain: Array, owner: Indices) -> Array:
    """``(T, E)`` the best gain among the other pairs of the same owner; 0 where there is none."""
    found = np.zeros_like(gain)
    for own in _columns_of(owner):
        if len(own) > 1:
            ranked = np.sort(gain[:, own], axis=1)
            best = gain[:, own] == ranked[:, -1:]
            found[:, own] = np.where(best, ranked[:, -2:-1], ranked[:, -1:])
    return found


def _columns_of(owner: Indices) -> list[Indices]:
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)

"""What the time of each object, or of each track, was spent on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.clear import NO_TRACK, Switches

#: What an object's strip says of an instant. WAITING: due, and not yet tracked. SWITCHED: by another track than last.
NOT_DUE, WAITING, TRACKED, SWITCHED, LOST = range(5)
#: Their names.
STATES = ("not due", "waiting", "tracked", "switched", "lost")


def strips(track_of: Indices, due: Mask, changes: Switches) -> npt.NDArray[np.int8]:
    """``(T, N)`` NOT_DUE, WAITING, TRACKED, SWITCHED or LOST."""
    tracked = track_of != NO_TRACK
    untracked = np.where(np.logical_or.accumulate(tracked, axis=0), LOST, WAITING)
    found = np.where(due, np.where(tracked, TRACKED, untracked), NOT_DUE).astype(np.int8)
    found[changes.instant, changes.object] = SWITCHED
    return found


class Stretches(NamedTuple):
    """Stretches ``(S,)`` of instants at which an object, or a track, is there and has a partner or has none."""

    owner: Indices
    """Number of the object or track, in increasing order."""
    paired: Mask
    start: Indices
    """Instant."""
    before: Indices
    """The owner's last instant before, -1 where this is its first stretch."""
    cost: Array
    """Sum over its instants."""
    last: Mask
    """Whether it is the owner's last stretch."""


def stretches(there: Mask, paired: Mask, cost: Array) -> Stretches:
    """Instants at which the owner is not there are passed over.

    Args:
        there: ``(T, owners)``.
        paired: ``(T, owners)``.
        cost: ``(T, owners)`` of each instant.
    """
    owner, instant = np.nonzero(there.T)
    with_partner = paired[instant, owner]
    changes = (owner[1:] != owner[:-1]) | (with_partner[1:] != with_partner[:-1])
    start = np.flatnonzero(np.concatenate([[True], changes])) if len(owner) else np.empty(0, dtype=np.intp)
    own = owner[start]
    first = np.concatenate([[True], own[1:] != own[:-1]])[: len(own)]
    before = np.where(first, -1, instant[np.maximum(start - 1, 0)])
    last = np.concatenate([own[1:] != own[:-1], [True]])[: len(own)]
    total = np.add.reduceat(cost[instant, owner], start) if len(start) else np.empty(0)
    return Stretches(own, with_partner[start], instant[start], before, total, last)

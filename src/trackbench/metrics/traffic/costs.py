"""To which objects and tracks GOSPA's cost of what is missed and false is due."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.assignment import Counted, NearPairs

NONE = -1


class Costs(NamedTuple):
    """The parts of squared GOSPA of missed objects and false tracks, m^2, by whose they are."""

    missed: Array
    """``(T, N)``."""
    false: Array
    """``(T, tracks)``."""


class _Partners(NamedTuple):
    column: Indices
    """``(T, N)`` of the track of each object."""
    object: Indices
    """``(T, K)`` of each column."""

    def add(self, pairs: NearPairs) -> None:
        self.column[pairs.instant, pairs.object] = pairs.column
        self.object[pairs.instant, pairs.column] = pairs.object


def costs(of_gospa: Counted, of_clear: Counted) -> Costs:
    """Half of the squared cutoff for each due object and each track that GOSPA leaves without a partner.

    CLEAR, by whose matching events are told, can have a partner for it that GOSPA gives to another one, which in CLEAR
    has yet another partner, and so on. The cost goes to the last of this chain, which is the one too many in CLEAR.
    """
    half, due, track = of_gospa.cutoff**2 / 2, of_gospa.due, of_gospa.track
    gospa, clear = (_Partners(np.full(due.shape, NONE), np.full(track.shape, NONE)) for _ in range(2))
    gospa.add(of_gospa.matched)
    clear.add(of_clear.matched)
    missed, false = np.zeros(due.shape), np.zeros((len(due), len(of_gospa.ids)))
    instant, item = np.nonzero(due & (gospa.column == NONE))
    np.add.at(missed, (instant, _last_of_chain(instant, item, clear.column, gospa.object)), half)
    gospa.add(of_gospa.excused)
    clear.add(of_clear.excused)
    instant, column = np.nonzero(of_gospa.present & (gospa.object == NONE))
    column = _last_of_chain(instant, column, clear.object, gospa.column)
    np.add.at(false, (instant, track[instant, column]), half)
    return Costs(missed, false)


def _last_of_chain(instant: Indices, item: Indices, partner: Indices, owner: Indices) -> Indices:
    """From each item to the owner of its partner, as long as there is one."""
    item, moving = item.copy(), np.arange(len(item))
    while len(moving):
        other = partner[instant[moving], item[moving]]
        moving, other = moving[other != NONE], other[other != NONE]
        following = owner[instant[moving], other]
        moving, following = moving[following != NONE], following[following != NONE]
        item[moving] = following
    return item

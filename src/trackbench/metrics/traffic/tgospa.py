"""T-GOSPA: GOSPA of whole trajectories, in which a change of an object's track costs too."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.assignment import Counted
from trackbench.metrics.traffic.object_track_pairs import ObjectTrackPairs
from trackbench.metrics.traffic.trajectory_paths import ROUNDING, Weights, solve_one, solve_together


class TgospaParts(NamedTuple):
    """The parts of T-GOSPA to the power 2, m^2, summed over the instants; the metric is the root of their sum."""

    localisation: float
    missed: float
    false: float
    switch: float
    exact: bool
    """False where the linear program of a group had a cheaper optimum than any assignment (it is a metric too), or the
    group was too large even for that and was assigned from instant to instant: an upper bound."""

    @property
    def total(self) -> float:
        """m^2."""
        return self.localisation + self.missed + self.false + self.switch


def tgospa(counted: Counted, switch: float) -> TgospaParts:
    """Trajectory GOSPA metric with p = 2: a change from one track to another costs ``switch`` squared (m), to or from
    none half of that.

    Objects are solved one by one. Those that use the same track at an instant are then solved together, by dynamic
    programming over their joint assignments or, where these are too many, by linear programming. Optima of all groups
    without a conflict are an optimum of the whole. ``exact`` says whether they were found.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", IEEE Transactions on Signal Processing 68, section III.
    """
    pairs, square = counted.pairs, counted.cutoff**2
    gain = square - pairs.distance**2
    order = np.argsort(pairs.object, kind="stable")
    bounds = np.searchsorted(pairs.object[order], np.arange(counted.due.shape[1] + 1))
    of_object = np.split(order, bounds[1:-1])

    def pairs_of(objects: frozenset[int]) -> ObjectTrackPairs:
        own = np.concatenate([of_object[item] for item in sorted(objects)])
        return _near_pairs(pairs.instant[own], pairs.object[own], pairs.track[own], gain[own], len(counted.due))

    half = switch**2 / 2
    solved = {
        frozenset([item]): solve_one(pairs_of(frozenset([item])), half)
        for item, own in enumerate(of_object)
        if len(own)
    }
    while merged := _conflicts(solved):
        for group in merged:
            solved = {objects: weights for objects, weights in solved.items() if not objects <= group}
            solved[group] = solve_together(pairs_of(group), half)
    matched = sum(float(item.weight[item.pairs.gain > 0].sum()) for item in solved.values())
    return TgospaParts(
        localisation=square * matched - sum(item.saved() for item in solved.values()),
        missed=square / 2 * (float(counted.due.sum()) - matched),
        false=square / 2 * (float(counted.present.sum()) - matched),
        switch=half * sum(item.changes() for item in solved.values()),
        exact=all(item.exact for item in solved.values()),
    )


def _near_pairs(instant: Indices, objects: Indices, tracks: Indices, gain: Array, steps: int) -> ObjectTrackPairs:
    numbers = tracks.max() + 1
    pair, which = np.unique(objects * numbers + tracks, return_inverse=True)
    table = np.zeros((steps, len(pair)))
    table[instant, which] = gain
    return ObjectTrackPairs(*np.divmod(pair, numbers), table)


def _conflicts(solved: dict[frozenset[int], Weights]) -> list[frozenset[int]]:
    """Disjoint unions of the groups of which some together use a track more than once at an instant."""
    users: dict[int, list[tuple[frozenset[int], Array]]] = defaultdict(list)
    for objects, item in solved.items():
        for column in np.flatnonzero(item.weight.any(axis=0)).tolist():
            users[int(item.pairs.track[column])].append((objects, item.weight[:, column]))
    unions: list[frozenset[int]] = []
    for shared in users.values():
        if len(shared) > 1 and np.max(sum(weight for _, weight in shared)) > 1 + ROUNDING:
            union = frozenset().union(*(objects for objects, _ in shared))
            if any(objects != union for objects, _ in shared):
                touching = [other for other in unions if other & union]
                unions = [other for other in unions if not other & union] + [union.union(*touching)]
    return unions

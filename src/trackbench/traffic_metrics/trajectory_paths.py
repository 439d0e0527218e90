"""The cheapest sequence of assignments of objects to tracks, where changing costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.traffic_metrics.trajectory_program import relaxed_weights
from trackbench.types import Array, Indices, Mask

#: Joint assignments of a group up to which it is solved by dynamic programming.
LARGEST = 256
ROUNDING = 1e-9


class Couples(NamedTuple):
    """Couples ``(E,)`` of an object and a track that are near each other at some instant."""

    object: Indices
    track: Indices
    gain: Array
    """``(T, E)`` what it saves to have them assigned to each other."""


class Weights(NamedTuple):
    """A solution for some objects."""

    couples: Couples
    weight: Array
    """``(T, E)`` 1 where a couple is assigned; between 0 and 1 where the linear program was not tight."""
    exact: bool

    def saved(self) -> float:
        """The sum of the gains."""
        return float((self.couples.gain * self.weight).sum())

    def changes(self) -> float:
        """Assignments begun and ended within the run."""
        return float(np.abs(np.diff(self.weight, axis=0)).sum())


def solve_one(couples: Couples, half: float) -> Weights:
    """The optimum for the couples of one object. Source: Viterbi (1967), with two changes of equal cost for a switch.

    Args:
        couples: of one object.
        half: cost of beginning or ending an assignment.
    """
    if np.any(constant := _kept_throughout(couples, half)):
        return Weights(couples, np.broadcast_to(constant.astype(float), couples.gain.shape), True)
    return Weights(couples, _path_of_one(couples.gain, half)[0], True)


def solve_together(couples: Couples, half: float) -> Weights:
    """The optimum for several objects that compete for tracks."""
    bound, bounded, useful = _bounds(couples, half)
    if bound:
        return Weights(couples, bounded, True)
    couples = Couples(couples.object[useful], couples.track[useful], couples.gain[:, useful])
    members = _joint_assignments(couples)
    if members is None:
        weight = relaxed_weights(couples.object, couples.track, couples.gain, half)
        return Weights(couples, weight, bool(np.all(np.minimum(weight, 1 - weight) < ROUNDING)))
    return Weights(couples, _joint_path(couples.gain, members, half), True)


def _kept_throughout(couples: Couples, half: float) -> Mask:
    """``(E,)`` the couple that is best to keep for the whole run, if it is plain that one is: the rest would not gain
    enough for one change."""
    total = couples.gain.sum(axis=0)
    best = int(np.argmax(total))
    found = np.zeros(len(total), dtype=bool)
    found[best] = couples.gain.max(axis=1).sum() - total[best] <= half
    return found


def _costs(gain: Array, half: float) -> Array:
    """``(T, E + 1)`` least cost up to each instant, ending with each couple or, last, with none."""
    saved = np.hstack([gain, np.zeros((len(gain), 1))])
    costs = np.empty_like(saved)
    cost = np.zeros(saved.shape[1])
    for k, now in enumerate(saved):
        free = min(cost[-1], cost[:-1].min() + half)
        cost = np.minimum(cost, free + half)
        cost[-1] = free
        cost -= now
        costs[k] = cost
    return costs


def _path_of_one(gain: Array, half: float) -> tuple[Array, float]:
    """``(T, E)`` the couple to take at each instant, and the cost."""
    costs = _costs(gain, half)
    none = gain.shape[1]
    change = np.full(none + 1, 2 * half)
    change[none] = half
    taken = np.empty(len(gain), dtype=np.intp)
    taken[-1] = now = int(np.argmin(costs[-1]))
    for k in range(len(gain) - 2, -1, -1):
        before = costs[k] + (change if now != none else half)
        before[now] = costs[k, now]
        taken[k] = now = int(np.argmin(before))
    return (taken[:, None] == np.arange(none)).astype(float), float(costs[-1].min())


def _bounds(couples: Couples, half: float) -> tuple[bool, Array, Mask]:
    """Whether solving one object after another is optimal, that solution, and ``(E,)`` the couples of any optimum.

    Each object alone gives a lower bound, for the whole and for every couple; one after another, with the tracks that
    are taken left out, an upper one. What does not fit between them is no part of an optimum.
    """
    upper = lower = 0.0
    weight = np.zeros(couples.gain.shape)
    excess = np.zeros(len(couples.object))
    taken = np.zeros((len(weight), couples.track.max() + 1), dtype=bool)
    for item in np.unique(couples.object):
        own = np.flatnonzero(couples.object == item)
        gain, track = couples.gain[:, own], couples.track[own]
        path, cost = _path_of_one(np.where(taken[:, track], -np.inf, gain), half)
        weight[:, own] = path
        upper += cost
        taken[:, track] |= path > 0
        through = _costs(gain, half)[:, :-1] + _costs(gain[::-1], half)[::-1, :-1] + gain
        alone = float(_costs(gain, half)[-1].min())
        excess[own] = through.min(axis=0) - alone
        lower += alone
    slack = upper - lower + ROUNDING
    return slack <= 2 * ROUNDING, weight, excess <= slack


def _joint_assignments(couples: Couples) -> Array | None:
    """``(S, E)`` every set of couples without a common object or track; None where there are too many."""
    found: list[tuple[int, ...]] = [()]
    for item in np.unique(couples.object):
        own = np.flatnonzero(couples.object == item).tolist()
        found += [
            (*some, couple)
            for some in found
            for couple in own
            if all(couples.track[couple] != couples.track[other] for other in some)
        ]
        if len(found) > LARGEST:
            return None
    members = np.zeros((len(found), len(couples.object)))
    for row, some in enumerate(found):
        members[row, list(some)] = 1.0
    return members


def _joint_path(gain: Array, members: Array, half: float) -> Array:
    """``(T, E)`` the couples to take at each instant."""
    sizes = members.sum(axis=1)
    change = half * (sizes[:, None] + sizes - 2 * members @ members.T)
    saved = gain @ members.T
    cost = -saved[0]
    before = np.empty(saved.shape, dtype=np.intp)
    everyone = np.arange(len(members))
    for k in range(1, len(gain)):
        total = change + cost
        before[k] = total.argmin(axis=1)
        cost = total[everyone, before[k]] - saved[k]
    now = int(np.argmin(cost))
    taken = np.empty(len(gain), dtype=np.intp)
    for k in range(len(gain) - 1, -1, -1):
        taken[k] = now
        now = before[k, now]
    return np.asarray(members[taken])

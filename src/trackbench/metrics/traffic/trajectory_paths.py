"""The cheapest sequence of assignments of objects to tracks, where changing costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.metrics.traffic.couples import Couples, Settled, settled
from trackbench.metrics.traffic.matching import matched_in_group
from trackbench.metrics.traffic.trajectory_program import relaxed_weights

#: Joint assignments of a group up to which it is solved by dynamic programming.
LARGEST = 64
#: Weights to be decided up to which a group is solved by linear programming, in about .2 s.
LARGEST_PROGRAM = 20_000
ROUNDING = 1e-9


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
    return Weights(couples, _path_of_one(couples.gain, half), True)


def solve_together(couples: Couples, half: float) -> Weights:
    """The optimum for several objects that compete for tracks."""
    plain = settled(couples, half)
    useful = plain.assigned.any(axis=0) | np.any(couples.gain * plain.open > 0, axis=0)
    couples = Couples(couples.object[useful], couples.track[useful], couples.gain[:, useful])
    plain = Settled(plain.assigned[:, useful], plain.open[:, useful])
    members = _joint_assignments(couples)
    if members is not None:
        return Weights(couples, _joint_path(couples.gain, members, plain, half), True)
    if plain.open.sum() > LARGEST_PROGRAM:
        return Weights(couples, _path_step_by_step(couples, half), False)
    weight = relaxed_weights(couples, plain, half)
    return Weights(couples, weight, bool(np.all(np.minimum(weight, 1 - weight) == 0)))


def _kept_throughout(couples: Couples, half: float) -> Mask:
    """``(E,)`` the couple that is best to keep for the whole run, if the others would plainly not gain one switch."""
    total = couples.gain.sum(axis=0)
    best = int(np.argmax(total))
    found = np.zeros(len(total), dtype=bool)
    found[best] = couples.gain.max(axis=1).sum() - total[best] <= 2 * half
    return found


def _path_of_one(gain: Array, half: float) -> Array:
    """``(T, E)`` the couple to take at each instant; none gains less than any.

    While the order of the gains stays the same, so does the best choice: a change gains most where the order changes.
    """
    order = np.argsort(gain, axis=1, kind="stable")
    starts = np.concatenate([[0], np.flatnonzero(np.any(order[1:] != order[:-1], axis=1)) + 1])
    # Least cost up to each stretch that ends with each couple.
    costs = -np.add.reduceat(gain, starts, axis=0)
    for k in range(1, len(costs)):
        costs[k] += np.minimum(costs[k - 1], costs[k - 1].min() + 2 * half)
    taken = np.empty(len(starts), dtype=np.intp)
    taken[-1] = now = int(np.argmin(costs[-1]))
    for k in range(len(starts) - 2, -1, -1):
        best = int(np.argmin(costs[k]))
        taken[k] = now = now if costs[k, now] <= costs[k, best] + 2 * half else best
    path = np.repeat(taken, np.diff(starts, append=len(gain)))
    return np.asarray(path[:, None] == np.arange(gain.shape[1]), dtype=float)


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


def _joint_path(gain: Array, members: Array, plain: Settled, half: float) -> Array:
    """``(T, E)`` the couples to take at each instant."""
    sizes = members.sum(axis=1)
    change = half * (sizes[:, None] + sizes - 2 * members @ members.T)
    contradictions = plain.assigned @ (1 - members.T) + (~plain.assigned & ~plain.open) @ members.T
    costs = np.where(contradictions > 0, np.inf, -(gain @ members.T))
    before = np.empty(costs.shape, dtype=np.intp)
    everyone = np.arange(len(members))
    cost = costs[0]
    for k in range(1, len(gain)):
        total = change + cost
        before[k] = total.argmin(axis=1)
        cost = total[everyone, before[k]] + costs[k]
    now = int(np.argmin(cost))
    taken = np.empty(len(gain), dtype=np.intp)
    for k in range(len(gain) - 1, -1, -1):
        taken[k] = now
        now = before[k, now]
    return np.asarray(members[taken])


def _path_step_by_step(couples: Couples, half: float) -> Array:
    """``(T, E)`` the couples to take at each instant, decided without looking ahead: not optimal, but possible."""
    weight = np.zeros(couples.gain.shape)
    worth = couples.gain[0]
    for k in range(len(weight)):
        some = np.flatnonzero(worth > 0)
        if len(some):
            weight[k, some] = matched_in_group(couples.object[some], couples.track[some], worth[some])
        if k + 1 < len(weight):
            worth = couples.gain[k + 1] + np.where(weight[k] > 0, half, -half)
    return weight

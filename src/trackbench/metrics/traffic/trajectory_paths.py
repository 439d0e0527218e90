"""The cheapest sequence of assignments of objects to tracks, where changing costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.metrics.traffic.matching import matched_in_group
from trackbench.metrics.traffic.object_track_pairs import ObjectTrackPairs, Presolved, presolve
from trackbench.metrics.traffic.trajectory_program import relaxed_weights

#: Joint assignments of a group up to which it is solved by dynamic programming.
LARGEST = 64
#: Weights to be decided up to which a group is solved by linear programming, in about .2 s.
LARGEST_PROGRAM = 20_000
ROUNDING = 1e-9


class Weights(NamedTuple):
    """A solution for some objects."""

    pairs: ObjectTrackPairs
    weight: Array
    """``(T, E)`` 1 where a pair is assigned; between 0 and 1 where the linear program was not tight."""
    exact: bool

    def saved(self) -> float:
        """The sum of the gains."""
        return float((self.pairs.gain * self.weight).sum())

    def changes(self) -> float:
        """Assignments begun and ended within the run."""
        return float(np.abs(np.diff(self.weight, axis=0)).sum())


def solve_one(pairs: ObjectTrackPairs, half: float) -> Weights:
    """The optimum for the pairs of one object. Source: Viterbi (1967), with two changes of equal cost for a switch.

    Args:
        pairs: of one object.
        half: cost of beginning or ending an assignment.
    """
    if np.any(constant := _kept_throughout(pairs, half)):
        return Weights(pairs, np.broadcast_to(constant.astype(float), pairs.gain.shape), True)
    return Weights(pairs, _path_of_one(pairs.gain, half), True)


def solve_together(pairs: ObjectTrackPairs, half: float) -> Weights:
    """The optimum for several objects that compete for tracks."""
    plain = presolve(pairs, half)
    useful = plain.assigned.any(axis=0) | np.any(pairs.gain * plain.open > 0, axis=0)
    pairs = ObjectTrackPairs(pairs.object[useful], pairs.track[useful], pairs.gain[:, useful])
    plain = Presolved(plain.assigned[:, useful], plain.open[:, useful])
    members = _joint_assignments(pairs)
    if members is not None:
        return Weights(pairs, _joint_path(pairs.gain, members, plain, half), True)
    if plain.open.sum() > LARGEST_PROGRAM:
        return Weights(pairs, _path_step_by_step(pairs, half), False)
    weight = relaxed_weights(pairs, plain, half)
    return Weights(pairs, weight, bool(np.all(np.minimum(weight, 1 - weight) == 0)))


def _kept_throughout(pairs: ObjectTrackPairs, half: float) -> Mask:
    """``(E,)`` the pair that is best to keep for the whole run, if the others would plainly not gain one switch."""
    total = pairs.gain.sum(axis=0)
    best = int(np.argmax(total))
    found = np.zeros(len(total), dtype=bool)
    found[best] = pairs.gain.max(axis=1).sum() - total[best] <= 2 * half
    return found


def _path_of_one(gain: Array, half: float) -> Array:
    """``(T, E)`` the pair to take at each instant; none gains less than any.

    While the order of the gains stays the same, so does the best choice: a change gains most where the order changes.
    """
    order = np.argsort(gain, axis=1, kind="stable")
    starts = np.concatenate([[0], np.flatnonzero(np.any(order[1:] != order[:-1], axis=1)) + 1])
    # Least cost up to each stretch that ends with each pair.
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


def _joint_assignments(pairs: ObjectTrackPairs) -> Array | None:
    """``(S, E)`` every set of pairs without a common object or track; None where there are too many."""
    found: list[tuple[int, ...]] = [()]
    for item in np.unique(pairs.object):
        own = np.flatnonzero(pairs.object == item).tolist()
        found += [
            (*some, pair)
            for some in found
            for pair in own
            if all(pairs.track[pair] != pairs.track[other] for other in some)
        ]
        if len(found) > LARGEST:
            return None
    members = np.zeros((len(found), len(pairs.object)))
    for row, some in enumerate(found):
        members[row, list(some)] = 1.0
    return members


def _joint_path(gain: Array, members: Array, plain: Presolved, half: float) -> Array:
    """``(T, E)`` the pairs to take at each instant."""
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


def _path_step_by_step(pairs: ObjectTrackPairs, half: float) -> Array:
    """``(T, E)`` the pairs to take at each instant, decided without looking ahead: not optimal, but possible."""
    weight = np.zeros(pairs.gain.shape)
    worth = pairs.gain[0]
    for k in range(len(weight)):
        some = np.flatnonzero(worth > 0)
        if len(some):
            weight[k, some] = matched_in_group(pairs.object[some], pairs.track[some], worth[some])
        if k + 1 < len(weight):
            worth = pairs.gain[k + 1] + np.where(weight[k] > 0, half, -half)
    return weight

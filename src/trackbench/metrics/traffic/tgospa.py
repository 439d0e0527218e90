"""T-GOSPA: GOSPA of whole trajectories, in which a change of an object's track adds a cost."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted, last_instant
from trackbench.trackers.multi.association import assigned


class ObjectTrackPairs(NamedTuple):
    """Pairs ``(E,)`` of an object and a track that are within the cutoff at some instant."""

    object: Indices
    track: Indices
    gain: Array
    """``(T, E)`` cost that is saved at each instant by assigning each pair's object and track to each other, m^2."""


class Presolved(NamedTuple):
    """Masks ``(T, E)`` of pairs that every optimal assignment has, and of undecided pairs; other pairs are in none."""

    assigned: Mask
    open: Mask


def presolve(pairs: ObjectTrackPairs, half: float) -> Presolved:
    """Return masks of the pairs that every optimal assignment has at each instant, and of the undecided pairs.

    A pair has an advantage where it gains more than the best other pairs of its object and of its track together. Take
    a stretch of instants without a disadvantage. To assign the pair from the start of the stretch, or up to its end,
    costs at most three changes there: the pair begins or ends, and its object and its track each leave or take another.
    So the pair is assigned at every instant up to which, and from which on, its advantages in the stretch sum to more
    than these changes. Changes cost nothing where the run begins and ends.

    Args:
        pairs: pairs with a gain of 0 or more.
        half: cost of a change.
    """
    advantage = pairs.gain - _rivals(pairs.gain, pairs.object) - _rivals(pairs.gain, pairs.track)
    enough = (_since(advantage) > 3 * half) & (_since(advantage[::-1])[::-1] - advantage > 3 * half)
    assigned = enough & (advantage > 0)
    excluded = np.zeros_like(assigned)
    for owner in (pairs.object, pairs.track):
        for columns in _columns_of(owner):
            excluded[:, columns] |= assigned[:, columns].any(axis=1, keepdims=True)
    return Presolved(assigned, ~excluded)


def _since(advantage: Array) -> Array:
    """Sum the advantage over the instants since the last disadvantage; infinite where no disadvantage came before."""
    total = np.cumsum(advantage, axis=0)
    last = last_instant(advantage < 0)
    return np.where(last < 0, np.inf, total - np.take_along_axis(total, np.maximum(last, 0), axis=0))


def _rivals(gain: Array, owner: Indices) -> Array:
    """Return, for each pair, the best gain among other pairs of the pair's owner, ``(T, E)``; 0 if there are none."""
    rivals = np.zeros_like(gain)
    for columns in _columns_of(owner):
        if len(columns) > 1:
            ranked = np.sort(gain[:, columns], axis=1)
            best = gain[:, columns] == ranked[:, -1:]
            rivals[:, columns] = np.where(best, ranked[:, -2:-1], ranked[:, -1:])
    return rivals


def _columns_of(owner: Indices) -> list[Indices]:
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)


#: Tolerance of the solver.
TOLERANCE = 1e-6


def relaxed_weights(pairs: ObjectTrackPairs, plain: Presolved, half: float) -> Array:
    """Return the weight of each pair at each instant in the cheapest solution, ``(T, E)`` from 0 to 1.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", section IV (the relaxation is a metric too).

    Args:
        pairs: pairs of objects and tracks, with their gains.
        plain: pairs that every optimum assigns, and undecided pairs.
        half: cost of a change of a weight by one from one instant to the next.
    """
    # Their import takes .2 s, and few runs need them.
    from scipy.optimize import linprog
    from scipy.sparse import bmat, csr_matrix, eye, vstack

    weight = plain.assigned.astype(float)
    steps, size = weight.shape
    instant, pair = np.nonzero(plain.open)
    variables = np.arange(len(instant))
    limits = []
    for owner in (pairs.object, pairs.track):
        _, row = np.unique(instant * (owner.max() + 1) + owner[pair], return_inverse=True)
        limits.append(csr_matrix((np.ones(len(row)), (row, variables))))
    at_most_one = vstack(limits)
    # The weight after each pair of instants minus that before it, where one of them is to be decided.
    number = np.full((steps, size), -1)
    number[instant, pair] = variables
    before, after, constant = number[:-1].reshape(-1), number[1:].reshape(-1), np.diff(weight, axis=0).reshape(-1)
    is_free = (before >= 0) | (after >= 0)
    before, after, constant = before[is_free], after[is_free], constant[is_free]
    rows, columns, signs = [], [], []
    for which, sign in ((before, -1.0), (after, 1.0)):
        there = np.flatnonzero(which >= 0)
        rows.append(there)
        columns.append(which[there])
        signs.append(np.full(len(there), sign))
    places = (np.concatenate(rows), np.concatenate(columns))
    change = csr_matrix((np.concatenate(signs), places), (len(constant), len(variables)))
    solved = linprog(
        np.concatenate([-pairs.gain[instant, pair], np.full(len(constant), half)]),
        A_ub=bmat([[at_most_one, None], [change, -eye(len(constant))], [-change, -eye(len(constant))]], "csr"),
        b_ub=np.concatenate([np.ones(at_most_one.shape[0]), -constant, constant]),
        bounds=(0, None),
        method="highs",
    )
    assert solved.x is not None, solved.message
    solution = np.clip(solved.x[: len(variables)], 0, 1)
    nearest = np.round(solution)
    weight[instant, pair] = np.where(np.abs(solution - nearest) < TOLERANCE, nearest, solution)
    return weight


#: Largest number of joint assignments of a group that is solved by dynamic programming.
LARGEST = 64
#: Largest number of undecided weights of a group that is solved by linear programming, in about .2 s.
LARGEST_PROGRAM = 20_000
ROUNDING = 1e-9


class Weights(NamedTuple):
    """Assignments of an object, or of a group of objects, to tracks: a weight of each pair at each instant."""

    pairs: ObjectTrackPairs
    weight: Array
    """``(T, E)`` 1 where a pair is assigned, else 0; between 0 and 1 where the linear program has no integer
    optimum."""
    exact: bool

    def saved(self) -> float:
        """Return how much lower the assignments make the cost than with all objects missed and all tracks false."""
        return float((self.pairs.gain * self.weight).sum())

    def changes(self) -> float:
        """Return the number of assignments that begin or end within the run."""
        return float(np.abs(np.diff(self.weight, axis=0)).sum())


def solve_one(pairs: ObjectTrackPairs, half: float) -> Weights:
    """Return the optimal assignment for the pairs of one object. Source: Viterbi (1967); a switch is two changes.

    Args:
        pairs: pairs of one object.
        half: cost of beginning or ending an assignment.
    """
    total = pairs.gain.sum(axis=0)
    best = int(np.argmax(total))
    if pairs.gain.max(axis=1).sum() - total[best] <= 2 * half:
        # One track for the whole run: the gain of all others together is less than the cost of a switch.
        weight = np.zeros(pairs.gain.shape)
        weight[:, best] = 1.0
        return Weights(pairs, weight, True)
    return Weights(pairs, _path_of_one(pairs.gain, half), True)


def solve_together(every: ObjectTrackPairs, half: float) -> Weights:
    """Return the optimal assignments of several objects that compete for tracks; ``half``: cost of a change, m^2."""
    plain = presolve(every, half)
    useful = np.any(plain.assigned | (every.gain * plain.open > 0), axis=0)
    pairs = ObjectTrackPairs(every.object[useful], every.track[useful], every.gain[:, useful])
    plain = Presolved(plain.assigned[:, useful], plain.open[:, useful])
    members = _joint_assignments(pairs)
    if members is not None:
        return Weights(pairs, _joint_path(pairs.gain, members, plain, half), True)
    if plain.open.sum() > LARGEST_PROGRAM:
        return Weights(pairs, _path_step_by_step(pairs, half), False)
    weight = relaxed_weights(pairs, plain, half)
    return Weights(pairs, weight, bool(np.all(np.minimum(weight, 1 - weight) == 0)))


def _path_of_one(gain: Array, half: float) -> Array:
    """Return which of its E pairs a lone object takes at each instant, ``(T, E)``; a change costs ``half`` twice.

    Gains are 0 or more, so the object always takes a pair. It changes only at instants at which the order of the gains
    changes: at other instants a change gains no more.
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
    """Return every set of pairs without an object or track twice, ``(S, E)``: 1 where set S has pair E, else 0.

    The result is None where there are too many sets.
    """
    sets: list[tuple[int, ...]] = [()]
    for item in np.unique(pairs.object):
        pairs_of_item = np.flatnonzero(pairs.object == item).tolist()
        sets += [
            (*members_of_set, pair)
            for members_of_set in sets
            for pair in pairs_of_item
            if all(pairs.track[pair] != pairs.track[other] for other in members_of_set)
        ]
        if len(sets) > LARGEST:
            return None
    members = np.zeros((len(sets), len(pairs.object)))
    for row, members_of_set in enumerate(sets):
        members[row, list(members_of_set)] = 1.0
    return members


def _joint_path(gain: Array, members: Array, plain: Presolved, half: float) -> Array:
    sizes, steps = members.sum(axis=1), len(gain)
    change = half * (sizes[:, None] + sizes - 2 * members @ members.T)
    contradictions = plain.assigned @ (1 - members.T) + (~plain.assigned & ~plain.open) @ members.T
    costs = np.where(contradictions > 0, np.inf, -(gain @ members.T))
    before = np.empty(costs.shape, dtype=np.intp)
    cost, sets = costs[0].copy(), np.arange(len(members))
    for k in range(1, steps):
        total = change + cost
        before[k] = total.argmin(axis=1)
        cost = total[sets, before[k]] + costs[k]
    taken = np.empty(steps, dtype=np.intp)
    now = int(cost.argmin())
    for k in range(steps - 1, -1, -1):
        taken[k] = now
        now = int(before[k, now])
    return np.asarray(members[taken])


def _path_step_by_step(pairs: ObjectTrackPairs, half: float) -> Array:
    """Choose the pairs instant by instant without looking ahead, ``(T, E)``: a feasible assignment, but not optimal."""
    weight = np.zeros(pairs.gain.shape)
    worth = pairs.gain[0]
    for k in range(len(weight)):
        useful = np.flatnonzero(worth > 0)
        if len(useful):
            weight[k, useful] = assigned(pairs.object[useful], pairs.track[useful], worth[useful])
        if k + 1 < len(weight):
            worth = pairs.gain[k + 1] + np.where(weight[k] > 0, half, -half)
    return weight


class TgospaParts(NamedTuple):
    """Parts of squared T-GOSPA, m^2, summed over the instants; T-GOSPA is the root of their sum."""

    localisation: float
    missed: float
    false: float
    switch: float
    exact: bool
    """Whether the optimum was found. It was not found if the linear program of a group has a cheaper optimum than any
    assignment (which is a metric too), or if a group was too large and was assigned from instant to instant, which
    gives an upper bound."""

    @property
    def total(self) -> float:
        """Squared T-GOSPA, m^2: the sum of localisation, missed, false and switches."""
        return self.localisation + self.missed + self.false + self.switch


def tgospa(counted: Counted, switch: float) -> TgospaParts:
    """Return the parts of T-GOSPA, GOSPA of trajectories, with p = 2; ``switch`` is the cost of a switch, m.

    A change from one track to another costs ``switch`` squared; a change to or from no track half of it. Objects are
    solved one by one. Objects that use the same track at an instant are then solved together, by dynamic programming
    over their joint assignments or, where these are too many, by linear programming. Optima of all groups without a
    conflict are an optimum of the whole.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", IEEE Transactions on Signal Processing 68, section III.
    """
    gains, half, square = _Gains(counted), switch**2 / 2, counted.cutoff**2
    alone = (frozenset([item]) for item, pairs_of_item in enumerate(gains.of_object) if len(pairs_of_item))
    solved = {group: solve_one(gains.of_group(group), half) for group in alone}
    while merged := _conflicts(solved):
        for group in merged:
            solved = {objects: weights for objects, weights in solved.items() if not objects <= group}
            solved[group] = solve_together(gains.of_group(group), half)
    matched = sum(float(item.weight[item.pairs.gain > 0].sum()) for item in solved.values())
    return TgospaParts(
        localisation=square * matched - sum(item.saved() for item in solved.values()),
        missed=square / 2 * (float(counted.due.sum()) - matched),
        false=square / 2 * (float(counted.present.sum()) - matched),
        switch=half * sum(item.changes() for item in solved.values()),
        exact=all(item.exact for item in solved.values()),
    )


class _Gains:
    def __init__(self, counted: Counted) -> None:
        pairs, numbers = counted.pairs, max(len(counted.ids), 1)
        couple, which = np.unique(pairs.object * numbers + pairs.track, return_inverse=True)
        gain = np.zeros((len(counted.due), len(couple)))
        gain[pairs.instant, which] = counted.cutoff**2 - pairs.distance**2
        self._pairs = ObjectTrackPairs(*np.divmod(couple, numbers), gain)
        bounds = np.searchsorted(self._pairs.object, np.arange(counted.due.shape[1] + 1))
        self.of_object = np.split(np.arange(len(couple)), bounds[1:-1])
        """Indices of the pairs of each object, one array for each object."""

    def of_group(self, objects: frozenset[int]) -> ObjectTrackPairs:
        """Return the pairs of each object of a group and each track that is within the cutoff at some instant."""
        at = np.concatenate([self.of_object[item] for item in sorted(objects)])
        return ObjectTrackPairs(self._pairs.object[at], self._pairs.track[at], self._pairs.gain.take(at, axis=1))


def _conflicts(solved: dict[frozenset[int], Weights]) -> list[frozenset[int]]:
    """Return unions, without common objects, of groups of objects that use the same track at an instant."""
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

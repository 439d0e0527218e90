"""T-GOSPA: GOSPA of whole trajectories, in which a change of an object's track costs too."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted, last_instant, matched_in_group


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
    rivals = np.zeros_like(gain)
    for own in _columns_of(owner):
        if len(own) > 1:
            ranked = np.sort(gain[:, own], axis=1)
            best = gain[:, own] == ranked[:, -1:]
            rivals[:, own] = np.where(best, ranked[:, -2:-1], ranked[:, -1:])
    return rivals


def _columns_of(owner: Indices) -> list[Indices]:
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)


#: Of the solver.
TOLERANCE = 1e-6


def relaxed_weights(pairs: ObjectTrackPairs, plain: Presolved, half: float) -> Array:
    """``(T, E)`` weights from 0 to 1 of the pairs at each instant, of least cost.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", section IV (the relaxation is a metric too).

    Args:
        pairs: of objects and tracks.
        plain: what need not be solved.
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
    some = (before >= 0) | (after >= 0)
    before, after, constant = before[some], after[some], constant[some]
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
    total = pairs.gain.sum(axis=0)
    best = int(np.argmax(total))
    if pairs.gain.max(axis=1).sum() - total[best] <= 2 * half:
        # Kept for the whole run: the others would plainly not gain one switch.
        weight = np.zeros(pairs.gain.shape)
        weight[:, best] = 1.0
        return Weights(pairs, weight, True)
    return Weights(pairs, _path_of_one(pairs.gain, half), True)


def solve_together(every: ObjectTrackPairs, halves: Sequence[float]) -> list[Weights]:
    """The optimum for several objects that compete for tracks, with each of some costs of a change."""
    plains = [presolve(every, half) for half in halves]
    useful = np.any([plain.assigned | (every.gain * plain.open > 0) for plain in plains], axis=(0, 1))
    pairs = ObjectTrackPairs(every.object[useful], every.track[useful], every.gain[:, useful])
    plains = [Presolved(plain.assigned[:, useful], plain.open[:, useful]) for plain in plains]
    members = _joint_assignments(pairs)
    if members is not None:
        return [Weights(pairs, weight, True) for weight in _joint_paths(pairs.gain, members, plains, halves)]
    if len(halves) > 1:
        # With one of the costs there may be fewer useful pairs.
        return [weights for half in halves for weights in solve_together(every, [half])]
    (plain,), (half,) = plains, halves
    return [_solve_large(pairs, plain, half)]


def _solve_large(pairs: ObjectTrackPairs, plain: Presolved, half: float) -> Weights:
    if plain.open.sum() > LARGEST_PROGRAM:
        return Weights(pairs, _path_step_by_step(pairs, half), False)
    weight = relaxed_weights(pairs, plain, half)
    return Weights(pairs, weight, bool(np.all(np.minimum(weight, 1 - weight) == 0)))


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
    sets: list[tuple[int, ...]] = [()]
    for item in np.unique(pairs.object):
        own = np.flatnonzero(pairs.object == item).tolist()
        sets += [
            (*some, pair)
            for some in sets
            for pair in own
            if all(pairs.track[pair] != pairs.track[other] for other in some)
        ]
        if len(sets) > LARGEST:
            return None
    members = np.zeros((len(sets), len(pairs.object)))
    for row, some in enumerate(sets):
        members[row, list(some)] = 1.0
    return members


def _joint_paths(gain: Array, members: Array, plains: Sequence[Presolved], halves: Sequence[float]) -> list[Array]:
    """``(T, E)`` the pairs to take at each instant, with each cost of a change."""
    sizes, (sets, steps) = members.sum(axis=1), (len(members), len(gain))
    apart = sizes[:, None] + sizes - 2 * members @ members.T
    change = np.array(halves)[:, None, None] * apart
    costs = np.empty((steps, len(halves), sets))
    for place, plain in enumerate(plains):
        contradictions = plain.assigned @ (1 - members.T) + (~plain.assigned & ~plain.open) @ members.T
        costs[:, place] = np.where(contradictions > 0, np.inf, -(gain @ members.T))
    before = np.empty(costs.shape, dtype=np.intp)
    total, first = np.empty(change.shape), sets * np.arange(len(halves) * sets).reshape(len(halves), sets)
    flat, cost = total.reshape(-1), costs[0].copy()
    # The costs of a change, which are few and apart from each other, are taken through the instants together.
    for k in range(1, steps):
        np.add(change, cost[:, None], out=total)
        total.argmin(axis=2, out=before[k])
        cost = flat.take(first + before[k])
        cost += costs[k]
    paths = []
    for place, now in enumerate(cost.argmin(axis=1).tolist()):
        own, taken = before[:, place].tolist(), np.empty(steps, dtype=np.intp)
        for k in range(steps - 1, -1, -1):
            taken[k] = now
            now = own[k][now]
        paths.append(np.asarray(members[taken]))
    return paths


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
    """Trajectory GOSPA metric with p = 2: a change from one track to another costs the square of the cost of a
    switch (m), to or from none half of it.

    Objects are solved one by one. Those that use the same track at an instant are then solved together, by dynamic
    programming over their joint assignments or, where these are too many, by linear programming. Optima of all groups
    without a conflict are an optimum of the whole.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", IEEE Transactions on Signal Processing 68, section III.

    Returns:
        Its parts; ``exact`` says whether the optimum was found.
    """
    (parts,) = tgospa_by_cost(counted, [switch])
    return parts


def tgospa_by_cost(counted: Counted, switches: Sequence[float]) -> list[TgospaParts]:
    """The metric for each of several ascending costs of a switch, m.

    An optimum without a change is one for every larger cost too.
    """
    groups, results = _Groups(counted, [switch**2 / 2 for switch in switches]), list[TgospaParts]()
    for place in range(len(switches)):
        results.append(results[-1] if results and not results[-1].switch else _solved(counted, groups, place))
    return results


class _Groups:
    """The optima of groups of objects, which are found once for all costs of a change."""

    def __init__(self, counted: Counted, halves: Sequence[float]) -> None:
        pairs, self.halves = counted.pairs, halves
        self._pairs, self._gain = pairs, counted.cutoff**2 - pairs.distance**2
        self._steps = len(counted.due)
        order = np.argsort(pairs.object, kind="stable")
        bounds = np.searchsorted(pairs.object[order], np.arange(counted.due.shape[1] + 1))
        self.of_object = np.split(order, bounds[1:-1])
        self._singles: dict[int, ObjectTrackPairs] = {}
        self._together: dict[frozenset[int], list[Weights]] = {}

    def single(self, item: int, place: int) -> Weights:
        """The optimum of one object, with one of the costs."""
        if item not in self._singles:
            self._singles[item] = self._pairs_of(frozenset([item]))
        return solve_one(self._singles[item], self.halves[place])

    def together(self, objects: frozenset[int], place: int) -> Weights:
        """That of several."""
        if objects not in self._together:
            self._together[objects] = solve_together(self._pairs_of(objects), self.halves)
        return self._together[objects][place]

    def _pairs_of(self, objects: frozenset[int]) -> ObjectTrackPairs:
        pairs = self._pairs
        own = np.concatenate([self.of_object[item] for item in sorted(objects)])
        numbers = pairs.track[own].max() + 1
        pair, which = np.unique(pairs.object[own] * numbers + pairs.track[own], return_inverse=True)
        table = np.zeros((self._steps, len(pair)))
        table[pairs.instant[own], which] = self._gain[own]
        return ObjectTrackPairs(*np.divmod(pair, numbers), table)


def _solved(counted: Counted, groups: _Groups, place: int) -> TgospaParts:
    """The metric with one of the costs."""
    half, square = groups.halves[place], counted.cutoff**2
    solved = {frozenset([item]): groups.single(item, place) for item, own in enumerate(groups.of_object) if len(own)}
    while merged := _conflicts(solved):
        for group in merged:
            solved = {objects: weights for objects, weights in solved.items() if not objects <= group}
            solved[group] = groups.together(group, place)
    matched = sum(float(item.weight[item.pairs.gain > 0].sum()) for item in solved.values())
    return TgospaParts(
        localisation=square * matched - sum(item.saved() for item in solved.values()),
        missed=square / 2 * (float(counted.due.sum()) - matched),
        false=square / 2 * (float(counted.present.sum()) - matched),
        switch=half * sum(item.changes() for item in solved.values()),
        exact=all(item.exact for item in solved.values()),
    )


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

"""The linear program of T-GOSPA, for groups too large for dynamic programming."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.traffic.object_track_pairs import ObjectTrackPairs, Presolved

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
    before, after, known = number[:-1].reshape(-1), number[1:].reshape(-1), np.diff(weight, axis=0).reshape(-1)
    some = (before >= 0) | (after >= 0)
    before, after, known = before[some], after[some], known[some]
    rows, columns, signs = [], [], []
    for which, sign in ((before, -1.0), (after, 1.0)):
        there = np.flatnonzero(which >= 0)
        rows.append(there)
        columns.append(which[there])
        signs.append(np.full(len(there), sign))
    places = (np.concatenate(rows), np.concatenate(columns))
    change = csr_matrix((np.concatenate(signs), places), (len(known), len(variables)))
    solved = linprog(
        np.concatenate([-pairs.gain[instant, pair], np.full(len(known), half)]),
        A_ub=bmat([[at_most_one, None], [change, -eye(len(known))], [-change, -eye(len(known))]], "csr"),
        b_ub=np.concatenate([np.ones(at_most_one.shape[0]), -known, known]),
        bounds=(0, None),
        method="highs",
    )
    assert solved.x is not None, solved.message
    found = np.clip(solved.x[: len(variables)], 0, 1)
    nearest = np.round(found)
    weight[instant, pair] = np.where(np.abs(found - nearest) < TOLERANCE, nearest, found)
    return weight

"""The linear program of T-GOSPA, for groups too large for dynamic programming."""

from __future__ import annotations

import numpy as np

from trackbench.types import Array, Indices


def relaxed_weights(objects: Indices, tracks: Indices, gain: Array, half: float) -> Array:
    """``(T, E)`` weights from 0 to 1 of couples of an object and a track, of least cost.

    Source: Garcia-Fernandez, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", section IV (the relaxation is a metric too).

    Args:
        objects: ``(E,)``.
        tracks: ``(E,)``.
        gain: ``(T, E)`` what a weight of one saves at each instant.
        half: cost of a change of a weight by one from one instant to the next.
    """
    # Their import takes .2 s, and few runs need them.
    from scipy.optimize import linprog
    from scipy.sparse import bmat, csr_matrix, diags, eye, kron

    steps, couples = gain.shape
    size = steps * couples
    ends = [np.unique(values, return_inverse=True)[1] for values in (objects, tracks)]
    each = [csr_matrix((np.ones(couples), (end, np.arange(couples))), (end.max() + 1, couples)) for end in ends]
    at_most_one = bmat([[kron(eye(steps), matrix)] for matrix in each])
    step = kron(diags([-1.0, 1.0], [0, 1], (steps - 1, steps)), eye(couples))
    unit = eye(step.shape[0])
    solved = linprog(
        np.concatenate([-gain.reshape(-1), np.full(step.shape[0], half)]),
        A_ub=bmat([[at_most_one, None], [step, -unit], [-step, -unit]], "csr"),
        b_ub=np.concatenate([np.ones(at_most_one.shape[0]), np.zeros(2 * step.shape[0])]),
        bounds=(0, None),
        method="highs",
    )
    assert solved.x is not None, solved.message
    return np.asarray(np.clip(solved.x[:size], 0, 1).reshape(steps, couples))

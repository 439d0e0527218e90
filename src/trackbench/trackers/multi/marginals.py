"""Association probabilities: of all ways to associate tracks and detections, the share in which a pair is associated.

A way to associate gives each track at most one detection and each detection at most one track; its probability is
proportional to the product of the weights of its pairs.
"""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.engine.equations import Compute, Equations, by_numpy

#: Messages are passed until none changes by more than this, relative to the largest that a message can be...
TOLERANCE = 1e-6
#: ...or so often.
MOST_ITERATIONS = 200
#: Clusters whose enumeration has more terms are computed by NumPy: they are rare, and take long to compile.
MOST_TERMS = 256


def marginals(
    track: Indices,
    detection: Indices,
    weight: Array,
    sizes: tuple[int, int],
    max_cluster: int,
    compute: Compute = by_numpy,
) -> Array:
    """``(P,)`` association probability of each pair.

    Args:
        track, detection: ``(P,)`` of each pair, sorted by track; pairs that share neither, nor are linked by others, do
            not compete.
        weight: ``(P,)`` probability of the pair over that of neither being associated.
        sizes: how many tracks and how many detections there are.
        max_cluster: clusters of more tracks and more detections than this are left to belief propagation.
        compute: how equations are computed.
    """
    tracks, detections = sizes
    found = weight / (1.0 + weight)
    rivals = np.flatnonzero(
        (np.bincount(track, minlength=tracks)[track] > 1)
        | (np.bincount(detection, minlength=detections)[detection] > 1)
    )
    if len(rivals):
        found[rivals] = _of_clusters(track[rivals], detection[rivals], weight[rivals], sizes, max_cluster, compute)
    return found


def _of_clusters(
    track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], max_cluster: int, compute: Compute
) -> Array:
    of_track, of_detection = _clusters(track, detection, sizes)
    (row, rows), (column, columns) = (_rank(of, len(track)) for of in (of_track, of_detection))
    cluster = of_track[track]
    found = np.empty(len(track))
    loopy = np.minimum(rows, columns)[cluster] > max_cluster
    if loopy.any():
        found[loopy] = belief_propagation(track[loopy], detection[loopy], weight[loopy], sizes)
    shape = np.where(loopy, -1, (rows * (sizes[1] + 1) + columns)[cluster])
    for key in np.unique(shape):
        if key < 0:
            continue
        pairs = np.flatnonzero(shape == key)
        own, place = np.unique(cluster[pairs], return_inverse=True)
        at = (row[track[pairs]], column[detection[pairs]], place)
        dense = np.zeros((*divmod(int(key), sizes[1] + 1), len(own)))
        dense[at] = weight[pairs]
        terms = dense.shape[0] * dense.shape[1] * 2 ** min(dense.shape[:2])
        by = compute if terms <= MOST_TERMS else by_numpy
        found[pairs] = by(ENUMERATION, {"weight": dense})["share"][at]
    return found


def enumeration(weight: Array) -> Array:
    """Exact association probabilities ``(T, D, ...)`` of clusters with the weights ``(T, D, ...)``.

    The sum over all associations runs over the tracks one by one and keeps, for each set of detections in use, the
    sum of all that lead there: ``T 2^D`` terms in place of one for each association.
    """
    if len(weight) < weight.shape[1]:
        return np.swapaxes(enumeration(np.swapaxes(weight, 0, 1)), 0, 1)
    tracks, detections = weight.shape[:2]
    # Likelihood ratios may be huge, and their products no number: what counts is each against the largest of its track.
    none = 1.0 / (1.0 + weight.max(axis=1))
    weight = weight * none[:, None]
    free, used = (_with_detection(detections, state) for state in (0, 1))
    before = np.zeros((*(2,) * detections, *weight.shape[2:]))
    before[(0,) * detections] = 1.0
    forward = [before]
    for t in range(tracks):
        after = forward[-1] * none[t]
        for d in range(detections):
            after[used[d]] += forward[-1][free[d]] * weight[t, d]
        forward.append(after)
    every = tuple(range(detections))
    total = forward[-1].sum(axis=every)
    found = np.zeros_like(weight)
    backward = np.ones_like(before)
    for t in reversed(range(tracks)):
        earlier = backward * none[t]
        for d in range(detections):
            rest = backward[used[d]]
            found[t, d] = weight[t, d] * (forward[t][free[d]] * rest).sum(axis=every[:-1]) / total
            earlier[free[d]] += rest * weight[t, d]
        backward = earlier
    return found


def belief_propagation(track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int]) -> Array:
    """Approximate association probabilities ``(P,)`` by loopy belief propagation; arguments as ``marginals`` has them.

    Source: Williams and Lau (2014), "Approximate evaluation of marginal association probabilities with belief
    propagation", algorithm 1.
    """
    tracks, detections = sizes
    # From a detection to a track: how free it is.
    free = np.ones(len(weight))
    for _ in range(MOST_ITERATIONS):
        wanted = weight * free
        others = np.bincount(track, wanted, tracks)[track] - wanted
        claim = weight / (1.0 + np.maximum(others, 0.0))
        rivals = np.bincount(detection, claim, detections)[detection] - claim
        before, free = free, 1.0 / (1.0 + np.maximum(rivals, 0.0))
        if np.abs(free - before).max() < TOLERANCE:
            break
    wanted = weight * free
    return np.asarray(wanted / (1.0 + np.bincount(track, wanted, tracks)[track]))


def _with_detection(detections: int, state: int) -> list[tuple[slice | int, ...]]:
    """For each detection, where it is free (0) or used (1) among the sets of detections, as axes of length 2."""
    return [(slice(None),) * d + (state,) for d in range(detections)]


#: The same as equations.
ENUMERATION = Equations(
    "association probabilities of a cluster",
    lambda values: {"share": enumeration(values["weight"])},
    {"weight": 2},
)


def _clusters(track: Indices, detection: Indices, sizes: tuple[int, int]) -> tuple[Indices, Indices]:
    """The cluster of each track and of each detection: the least number of its pairs; of no pair where it has none."""
    label = np.arange(len(track))
    found = np.full(sizes[0], len(track)), np.full(sizes[1], len(track))
    while True:
        before = label
        for of, which in zip(found, (track, detection), strict=True):
            np.minimum.at(of, which, label)
            label = of[which]
        if np.array_equal(label, before):
            return found


def _rank(cluster: Indices, pairs: int) -> tuple[Indices, Indices]:
    """The how-manieth of its cluster each is, and how many each cluster has."""
    order = np.argsort(cluster, kind="stable")
    counts = np.bincount(cluster, minlength=pairs + 1)
    rank = np.empty_like(cluster)
    rank[order] = np.arange(len(cluster)) - (np.cumsum(counts) - counts)[cluster[order]]
    return rank, counts

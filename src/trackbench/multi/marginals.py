"""Association probabilities: of all ways to associate tracks and detections, the share in which a pair is associated.

A way to associate gives each track at most one detection and each detection at most one track; its probability is
proportional to the product of the weights of its pairs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.types import Array, Indices

#: Messages are passed until none changes by more than this, relative to the largest that a message can be...
TOLERANCE = 1e-6
#: ...or so often.
MOST_ITERATIONS = 200


def marginals(track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], max_cluster: int) -> Array:
    """``(P,)`` association probability of each pair.

    Args:
        track, detection: ``(P,)`` of each pair; pairs that share neither, nor are linked by others, do not compete.
        weight: ``(P,)`` probability of the pair over that of neither being associated.
        sizes: how many tracks and how many detections there are.
        max_cluster: clusters of more tracks and more detections than this are left to belief propagation.
    """
    tracks, detections = sizes
    found = weight / (1.0 + weight)
    rivals = (np.bincount(track, minlength=tracks)[track] > 1) | (
        np.bincount(detection, minlength=detections)[detection] > 1
    )
    if np.any(rivals):
        found[rivals] = _of_clusters(track[rivals], detection[rivals], weight[rivals], sizes, max_cluster)
    return found


def _of_clusters(track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], max_cluster: int) -> Array:
    tracks, detections = sizes
    cluster = _clusters(track, detection, tracks, detections)
    track_count = np.bincount(cluster[:tracks], minlength=int(cluster.max()) + 1)
    detection_count = np.bincount(cluster[tracks:], minlength=len(track_count))
    of_pair = cluster[track]
    found = np.empty(len(track))
    loopy = np.minimum(track_count, detection_count)[of_pair] > max_cluster
    if np.any(loopy):
        found[loopy] = belief_propagation(track[loopy], detection[loopy], weight[loopy], sizes)
    row, column = _rank(cluster[:tracks]), _rank(cluster[tracks:])
    shape = track_count * (detections + 1) + detection_count
    shape_of_pair = np.where(loopy, -1, shape[of_pair])
    for key in np.unique(shape_of_pair[~loopy]):
        pairs = np.flatnonzero(shape_of_pair == key)
        own, place = np.unique(of_pair[pairs], return_inverse=True)
        at = (row[track[pairs]], column[detection[pairs]], place)
        dense = np.zeros((*divmod(int(key), detections + 1), len(own)))
        dense[at] = weight[pairs]
        found[pairs] = enumeration(dense)[at]
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
    found = np.empty_like(weight)
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


def _clusters(track: Indices, detection: Indices, tracks: int, detections: int) -> Indices:
    """``(tracks + detections,)`` the number of the cluster of each."""
    sparse: Any = _sparse()
    links = (np.ones(len(track), dtype=bool), (track, detection + tracks))
    graph = sparse.coo_matrix(links, shape=(tracks + detections,) * 2)
    return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.intp)


def _rank(cluster: Indices) -> Indices:
    """The how-manieth of its cluster each is."""
    order = np.argsort(cluster, kind="stable")
    counts = np.bincount(cluster)
    rank = np.empty_like(cluster)
    rank[order] = np.arange(len(cluster)) - (np.cumsum(counts) - counts)[cluster[order]]
    return rank


def _sparse() -> Any:
    # A scenario that is only checked need not wait for this import.
    from scipy import sparse
    from scipy.sparse import csgraph

    assert csgraph
    return sparse

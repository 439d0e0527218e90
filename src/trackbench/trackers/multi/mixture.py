"""Association probabilities, and beliefs of tracks that share detections."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices
from trackbench.base.units import difference
from trackbench.engine.equations import Compute, Equations, by_numpy
from trackbench.filters import AnyBelief, Belief, MultiModelBelief
from trackbench.filters.base import wrap_components
from trackbench.filters.imm import LEAST_PROBABILITY
from trackbench.models.motion import MotionModel

#: Largest change of a cluster's messages at convergence, relative to the largest possible message.
TOLERANCE = 1e-6
MOST_ITERATIONS = 200
#: Largest number of terms of a compiled enumeration; larger clusters are rare, and slow to compile.
MOST_TERMS = 256


def marginals(
    track: Indices,
    detection: Indices,
    weight: Array,
    sizes: tuple[int, int],
    max_cluster: int,
    compute: Compute = by_numpy,
) -> Array:
    """Return the association probability of each pair of a track and a detection, ``(P,)``.

    Args:
        track: ``(P,)`` track of each pair, ascending.
        detection: ``(P,)`` detection of each pair.
        weight: ``(P,)`` odds of the pair against leaving both unassociated.
        sizes: number of tracks and number of detections.
        max_cluster: size above which a cluster of competing pairs is computed approximately, by belief propagation.
        compute: engine of the equations.
    """
    tracks, detections = sizes
    result = weight / (1.0 + weight)
    rivals = np.flatnonzero(
        (np.bincount(track, minlength=tracks)[track] > 1)
        | (np.bincount(detection, minlength=detections)[detection] > 1)
    )
    if len(rivals):
        result[rivals] = _in_clusters(track[rivals], detection[rivals], weight[rivals], sizes, max_cluster, compute)
    return result


def _in_clusters(
    track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], max_cluster: int, compute: Compute
) -> Array:
    track_cluster, detection_cluster = _clusters(track, detection, sizes)
    (row, rows), (column, columns) = (_ranks(labels, len(track)) for labels in (track_cluster, detection_cluster))
    cluster = track_cluster[track]
    result = np.empty(len(track))
    loopy = np.minimum(rows, columns)[cluster] > max_cluster
    if loopy.any():
        result[loopy] = belief_propagation(track[loopy], detection[loopy], weight[loopy], sizes, cluster[loopy])
    shape = np.where(loopy, -1, (rows * (sizes[1] + 1) + columns)[cluster])
    for key in np.unique(shape):
        if key < 0:
            continue
        pairs = np.flatnonzero(shape == key)
        clusters, place = np.unique(cluster[pairs], return_inverse=True)
        at = (row[track[pairs]], column[detection[pairs]], place)
        # For a single member NumPy sums in another order, so that bits would depend on the batch.
        dense = np.zeros((*divmod(int(key), sizes[1] + 1), max(2, len(clusters))))
        dense[at] = weight[pairs]
        terms = dense.shape[0] * dense.shape[1] * 2 ** min(dense.shape[:2])
        by = compute if terms <= MOST_TERMS else by_numpy
        result[pairs] = by(ENUMERATION, {"weight": dense})["share"][at]
    return result


def enumeration(weight: Array) -> Array:
    """Return exact association probabilities ``(T, D, ...)`` of clusters of T tracks and D detections.

    ``weight`` is each pair's odds against leaving both unassociated. Associations are summed track by track, with one
    partial sum for each set of used detections: ``T 2^D`` terms instead of one for each association.
    """
    if len(weight) < weight.shape[1]:
        return np.swapaxes(enumeration(np.swapaxes(weight, 0, 1)), 0, 1)
    tracks, detections = weight.shape[:2]
    # Products of likelihood ratios may overflow, so each is scaled by the largest of its track.
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
    result = np.zeros_like(weight)
    backward = np.ones_like(before)
    for t in reversed(range(tracks)):
        earlier = backward * none[t]
        for d in range(detections):
            rest = backward[used[d]]
            result[t, d] = weight[t, d] * (forward[t][free[d]] * rest).sum(axis=every[:-1]) / total
            earlier[free[d]] += rest * weight[t, d]
        backward = earlier
    return result


def belief_propagation(
    track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], cluster: Indices
) -> Array:
    """Return approximate association probabilities ``(P,)`` by loopy belief propagation.

    The arguments are those of :func:`marginals`; ``cluster`` ``(P,)`` is the number of each pair's cluster.

    Source: Williams and Lau (2014), "Approximate evaluation of marginal association probabilities with belief
    propagation", algorithm 1.
    """
    tracks, detections = sizes
    # Message from a detection to a track.
    free = np.ones(len(weight))
    moving = np.arange(len(weight))
    for _ in range(MOST_ITERATIONS):
        track_of_pair, detection_of_pair, pair_weight = track[moving], detection[moving], weight[moving]
        offers = pair_weight * free[moving]
        other_messages = np.bincount(track_of_pair, offers, tracks)[track_of_pair] - offers
        claim = pair_weight / (1.0 + np.maximum(other_messages, 0.0))
        rivals = np.bincount(detection_of_pair, claim, detections)[detection_of_pair] - claim
        after = 1.0 / (1.0 + np.maximum(rivals, 0.0))
        changed = np.bincount(cluster[moving], np.abs(after - free[moving]) >= TOLERANCE) > 0
        free[moving] = after
        moving = moving[changed[cluster[moving]]]
        if not len(moving):
            break
    offers = weight * free
    return np.asarray(offers / (1.0 + np.bincount(track, offers, tracks)[track]))


def _with_detection(detections: int, state: int) -> list[tuple[slice | int, ...]]:
    """Return for each detection the index of the sets of used detections in which it is free (0) or used (1)."""
    return [(slice(None),) * d + (state,) for d in range(detections)]


#: Equations of ``enumeration``, for the engine.
ENUMERATION = Equations(
    "association probabilities of a cluster", lambda values: {"share": enumeration(values["weight"])}, {"weight": 2}
)


def _clusters(track: Indices, detection: Indices, sizes: tuple[int, int]) -> tuple[Indices, Indices]:
    """Return the cluster of each track and detection: its least pair index; the number of pairs for no cluster."""
    label = np.arange(len(track))
    result = np.full(sizes[0], len(track)), np.full(sizes[1], len(track))
    while True:
        before = label
        for labels, members in zip(result, (track, detection), strict=True):
            np.minimum.at(labels, members, label)
            label = labels[members]
        if np.array_equal(label, before):
            return result


def _ranks(cluster: Indices, pairs: int) -> tuple[Indices, Indices]:
    """Return the position of each track (or detection) within its cluster, and their number in each cluster."""
    order = np.argsort(cluster, kind="stable")
    counts = np.bincount(cluster, minlength=pairs + 1)
    rank = np.empty_like(cluster)
    rank[order] = np.arange(len(cluster)) - (np.cumsum(counts) - counts)[cluster[order]]
    return rank, counts


def mix_pairs(
    motions: Sequence[MotionModel], before: AnyBelief, updated: AnyBelief, track: Indices, share: Array, miss: Array
) -> AnyBelief:
    """Return for each track the mixture of its prediction and of its updates, one update for each pair.

    Args:
        motions: motion models of the filter.
        before: predicted beliefs ``(n, L)``.
        updated: updated beliefs ``(n, P)``, one for each pair of a track and a detection; at least one.
        track: ``(P,)`` track of each pair, ascending.
        share: association probability ``(P,)`` of each pair.
        miss: probability ``(L,)`` that a track has no detection.
    """
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    own = track[begins]

    def one_model(angular: tuple[int, ...], before: Belief, updated: Belief, share: Array, miss: Array) -> Belief:
        mean, covariance = before.mean.copy(), before.covariance.copy()
        parts = _parts(angular, mean[:, track], updated, share)
        shift, spread = (np.add.reduceat(part, begins, axis=-1) for part in parts)
        result = _mixed(angular, Belief(mean[:, own], covariance[..., own]), shift, spread, miss[own])
        mean[:, own], covariance[..., own] = result.mean, result.covariance
        return Belief(mean, covariance)

    if isinstance(before, Belief):
        assert isinstance(updated, Belief)
        return one_model(motions[0].angular, before, updated, share, miss)
    assert isinstance(before, MultiModelBelief)
    assert isinstance(updated, MultiModelBelief)
    missed_modes, hit = miss * before.probability, share * updated.probability
    probability = np.stack([np.bincount(track, each, len(miss)) for each in hit]) + missed_modes
    probability = np.maximum(probability, LEAST_PROBABILITY)
    modes = [
        one_model(motion.angular, mode, other, hit[j] / probability[j, track], missed_modes[j] / probability[j])
        for j, (motion, mode, other) in enumerate(zip(motions, before.modes, updated.modes, strict=True))
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def mix_slots(
    motions: Sequence[MotionModel], before: AnyBelief, updated: Sequence[AnyBelief], share: Sequence[Array], miss: Array
) -> AnyBelief:
    """Return for each track the mixture of its prediction and of its updates, equally many for every track.

    Args:
        motions: motion models of the filter.
        before: predicted beliefs ``(n, ...)``.
        updated: updated beliefs ``(n, ...)``, one for each detection.
        share: association probability ``(...)`` of each update.
        miss: probability ``(...)`` that a track has no detection.
    """

    def one_model(
        angular: tuple[int, ...], before: Belief, updated: Sequence[Belief], share: Sequence[Array], miss: Array
    ) -> Belief:
        parts = [_parts(angular, before.mean, belief, weight) for belief, weight in zip(updated, share, strict=True)]
        shift, spread = (reduce(add, each) for each in zip(*parts, strict=True))
        return _mixed(angular, before, shift, spread, miss)

    singles = [belief for belief in updated if isinstance(belief, Belief)]
    if isinstance(before, Belief):
        return one_model(motions[0].angular, before, singles, share, miss)
    several = [belief for belief in updated if isinstance(belief, MultiModelBelief)]
    missed_modes, hit = (
        miss * before.probability,
        [weight * belief.probability for belief, weight in zip(several, share, strict=True)],
    )
    probability = np.maximum(reduce(add, hit) + missed_modes, LEAST_PROBABILITY)
    modes = [
        one_model(
            motion.angular,
            before.modes[j],
            [belief.modes[j] for belief in several],
            [each[j] / probability[j] for each in hit],
            missed_modes[j] / probability[j],
        )
        for j, motion in enumerate(motions)
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def _parts(angular: tuple[int, ...], mean: Array, updated: Belief, share: Array) -> tuple[Array, Array]:
    offset = difference(updated.mean, mean, angular)
    return share * offset, share * (updated.covariance + offset[:, None] * offset[None])


def _mixed(angular: tuple[int, ...], before: Belief, shift: Array, spread: Array, miss: Array) -> Belief:
    """Return the belief with mean ``shift`` and second moment ``spread`` about the prediction ``before``.

    With one gain for all detections, its covariance is the textbook one with the spread of the innovations.
    """
    covariance = miss * before.covariance + (spread - shift[:, None] * shift[None])
    return Belief(wrap_components(before.mean + shift, angular), linalg.symmetrise(covariance))

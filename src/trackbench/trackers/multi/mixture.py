"""Association probabilities, and the belief of a track that shares detections."""

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

#: Messages are passed until none of a cluster changes by more than this, relative to the largest that one can be...
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
    result = weight / (1.0 + weight)
    rivals = np.flatnonzero(
        (np.bincount(track, minlength=tracks)[track] > 1)
        | (np.bincount(detection, minlength=detections)[detection] > 1)
    )
    if len(rivals):
        result[rivals] = _of_clusters(track[rivals], detection[rivals], weight[rivals], sizes, max_cluster, compute)
    return result


def _of_clusters(
    track: Indices, detection: Indices, weight: Array, sizes: tuple[int, int], max_cluster: int, compute: Compute
) -> Array:
    of_track, of_detection = _clusters(track, detection, sizes)
    (row, rows), (column, columns) = (_rank(of, len(track)) for of in (of_track, of_detection))
    cluster = of_track[track]
    result = np.empty(len(track))
    loopy = np.minimum(rows, columns)[cluster] > max_cluster
    if loopy.any():
        result[loopy] = belief_propagation(track[loopy], detection[loopy], weight[loopy], sizes, cluster[loopy])
    shape = np.where(loopy, -1, (rows * (sizes[1] + 1) + columns)[cluster])
    for key in np.unique(shape):
        if key < 0:
            continue
        pairs = np.flatnonzero(shape == key)
        own, place = np.unique(cluster[pairs], return_inverse=True)
        at = (row[track[pairs]], column[detection[pairs]], place)
        # Of one member alone NumPy sums in another order, so that its bits would depend on the others.
        dense = np.zeros((*divmod(int(key), sizes[1] + 1), max(2, len(own))))
        dense[at] = weight[pairs]
        terms = dense.shape[0] * dense.shape[1] * 2 ** min(dense.shape[:2])
        by = compute if terms <= MOST_TERMS else by_numpy
        result[pairs] = by(ENUMERATION, {"weight": dense})["share"][at]
    return result


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
    """Approximate association probabilities ``(P,)`` by loopy belief propagation; arguments as ``marginals`` has them,
    and ``(P,)`` the number of each pair's cluster.

    Source: Williams and Lau (2014), "Approximate evaluation of marginal association probabilities with belief
    propagation", algorithm 1.
    """
    tracks, detections = sizes
    # From a detection to a track: how free it is.
    free = np.ones(len(weight))
    moving = np.arange(len(weight))
    for _ in range(MOST_ITERATIONS):
        of, to, own = track[moving], detection[moving], weight[moving]
        wanted = own * free[moving]
        others = np.bincount(of, wanted, tracks)[of] - wanted
        claim = own / (1.0 + np.maximum(others, 0.0))
        rivals = np.bincount(to, claim, detections)[to] - claim
        after = 1.0 / (1.0 + np.maximum(rivals, 0.0))
        changed = np.bincount(cluster[moving], np.abs(after - free[moving]) >= TOLERANCE) > 0
        free[moving] = after
        moving = moving[changed[cluster[moving]]]
        if not len(moving):
            break
    wanted = weight * free
    return np.asarray(wanted / (1.0 + np.bincount(track, wanted, tracks)[track]))


def _with_detection(detections: int, state: int) -> list[tuple[slice | int, ...]]:
    """For each detection, where it is free (0) or used (1) among the sets of detections, as axes of length 2."""
    return [(slice(None),) * d + (state,) for d in range(detections)]


#: The same as equations.
ENUMERATION = Equations(
    "association probabilities of a cluster", lambda values: {"share": enumeration(values["weight"])}, {"weight": 2}
)


def _clusters(track: Indices, detection: Indices, sizes: tuple[int, int]) -> tuple[Indices, Indices]:
    """The cluster of each track and of each detection: the least number of its pairs; of no pair where it has none."""
    label = np.arange(len(track))
    result = np.full(sizes[0], len(track)), np.full(sizes[1], len(track))
    while True:
        before = label
        for of, which in zip(result, (track, detection), strict=True):
            np.minimum.at(of, which, label)
            label = of[which]
        if np.array_equal(label, before):
            return result


def _rank(cluster: Indices, pairs: int) -> tuple[Indices, Indices]:
    """The how-manieth of its cluster each is, and how many each cluster has."""
    order = np.argsort(cluster, kind="stable")
    counts = np.bincount(cluster, minlength=pairs + 1)
    rank = np.empty_like(cluster)
    rank[order] = np.arange(len(cluster)) - (np.cumsum(counts) - counts)[cluster[order]]
    return rank, counts


def of_pairs(
    motions: Sequence[MotionModel], before: AnyBelief, updated: AnyBelief, track: Indices, share: Array, kept: Array
) -> AnyBelief:
    """Of L tracks, with the possibilities side by side.

    Args:
        motions: the motion models.
        before: ``(n, L)`` the predictions.
        updated: ``(n, P)`` of each pair of a track and a detection, of one at least.
        track: ``(P,)`` ascending.
        share: ``(P,)`` the probability of each pair.
        kept: ``(L,)`` the probability that there was no detection.
    """
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    own = track[begins]

    def one_model(angular: tuple[int, ...], before: Belief, updated: Belief, share: Array, kept: Array) -> Belief:
        mean, covariance = before.mean.copy(), before.covariance.copy()
        parts = _parts(angular, mean[:, track], updated, share)
        shift, spread = (np.add.reduceat(part, begins, axis=-1) for part in parts)
        result = _mixed(angular, Belief(mean[:, own], covariance[..., own]), shift, spread, kept[own])
        mean[:, own], covariance[..., own] = result.mean, result.covariance
        return Belief(mean, covariance)

    if isinstance(before, Belief):
        assert isinstance(updated, Belief)
        return one_model(motions[0].angular, before, updated, share, kept)
    assert isinstance(before, MultiModelBelief)
    assert isinstance(updated, MultiModelBelief)
    missed, hit = kept * before.probability, share * updated.probability
    probability = np.stack([np.bincount(track, each, len(kept)) for each in hit]) + missed
    probability = np.maximum(probability, LEAST_PROBABILITY)
    modes = [
        one_model(motion.angular, mode, other, hit[j] / probability[j, track], missed[j] / probability[j])
        for j, (motion, mode, other) in enumerate(zip(motions, before.modes, updated.modes, strict=True))
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def of_slots(
    motions: Sequence[MotionModel], before: AnyBelief, updated: Sequence[AnyBelief], share: Sequence[Array], kept: Array
) -> AnyBelief:
    """Of tracks that all have the same number of possibilities.

    Args:
        motions: the motion models.
        before: ``(n, ...)`` the predictions.
        updated: ``(n, ...)`` with each detection.
        share: ``(...)`` the probability of each.
        kept: ``(...)`` the probability that there was no detection.
    """

    def one_model(
        angular: tuple[int, ...], before: Belief, updated: Sequence[Belief], share: Sequence[Array], kept: Array
    ) -> Belief:
        parts = [_parts(angular, before.mean, belief, weight) for belief, weight in zip(updated, share, strict=True)]
        shift, spread = (reduce(add, each) for each in zip(*parts, strict=True))
        return _mixed(angular, before, shift, spread, kept)

    singles = [belief for belief in updated if isinstance(belief, Belief)]
    if isinstance(before, Belief):
        return one_model(motions[0].angular, before, singles, share, kept)
    several = [belief for belief in updated if isinstance(belief, MultiModelBelief)]
    missed, hit = (
        kept * before.probability,
        [weight * belief.probability for belief, weight in zip(several, share, strict=True)],
    )
    probability = np.maximum(reduce(add, hit) + missed, LEAST_PROBABILITY)
    modes = [
        one_model(
            motion.angular,
            before.modes[j],
            [belief.modes[j] for belief in several],
            [each[j] / probability[j] for each in hit],
            missed[j] / probability[j],
        )
        for j, motion in enumerate(motions)
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def _parts(angular: tuple[int, ...], mean: Array, updated: Belief, share: Array) -> tuple[Array, Array]:
    """What a possibility adds to the first and to the second moment about the prediction."""
    offset = difference(updated.mean, mean, angular)
    return share * offset, share * (updated.covariance + offset[:, None] * offset[None])


def _mixed(angular: tuple[int, ...], before: Belief, shift: Array, spread: Array, kept: Array) -> Belief:
    """The Gaussian of those moments.

    For a gain that is the same for each detection its covariance is the usual one with the spread of the innovations.
    """
    covariance = kept * before.covariance + (spread - shift[:, None] * shift[None])
    return Belief(wrap_components(before.mean + shift, angular), linalg.symmetrise(covariance))

"""Association that weighs all possibilities: each track takes the mean of what it would be with each detection."""

from __future__ import annotations

import numpy as np

from trackbench import linalg
from trackbench.filters import AnyBelief, Belief, MultiModelBelief, bare
from trackbench.filters.base import wrap_components
from trackbench.filters.imm import LEAST
from trackbench.multi.gate import GatedPairs
from trackbench.multi.hard import Association, Situation, updates
from trackbench.multi.marginals import marginals
from trackbench.multi.table import NONE
from trackbench.types import Array, Indices
from trackbench.units import difference


def weighed(at: Situation, pairs: GatedPairs, existence: Array | None, density: float, max_cluster: int) -> Association:
    """Joint probabilistic data association, with or without existence probabilities.

    Source: Fortmann, Bar-Shalom and Scheffe (1983), "Sonar tracking of multiple targets using joint probabilistic
    data association"; with existence Musicki and Evans (2004), "Joint integrated probabilistic data association:
    JIPDA", and Williams (2015), "Marginal multi-Bernoulli filters", equations 36 to 52, whose Bernoulli components are
    the same.

    Args:
        at: the situation.
        pairs: in the gates.
        existence: ``(2, L)`` predicted probability that the object exists, and that it is not hidden if so; None: both
            are certain.
        density: of detections that stem from none of the tracks.
        max_cluster: size of cluster up to which the association probabilities are exact.
    """
    track, detection = pairs.track, pairs.detection
    count, detections = len(at.run), len(at.detections.run)
    exists, visible = np.ones((2, count)) if existence is None else existence
    hit = exists[track] * at.detection_probability[track] * np.exp(pairs.log_likelihood) / density
    missed_existing, unseen = exists * at.miss, 1.0 - exists + exists * at.miss
    share = marginals(track, detection, hit / unseen[track], (count, detections), max_cluster)
    none = np.maximum(1.0 - np.bincount(track, share, count), 0.0)
    kept = none * missed_existing / unseen
    after = np.minimum(kept + np.bincount(track, share, count), 1.0)
    belief = _mixture(at, track, detection, share / after[track], kept / after)
    unclaimed = np.maximum(1.0 - np.bincount(detection, share, detections), 0.0)
    # Of an object that exists and was missed.
    still_visible = 1.0 - (1.0 - visible) / at.miss
    visible = (after - kept + kept * still_visible) / after
    ratio = np.log(unseen + np.bincount(track, hit, count))
    used = _largest(track, detection, share, none)
    return Association(belief, used, unclaimed, ratio, None if existence is None else np.array([after, visible]))


def _mixture(at: Situation, track: Indices, detection: Indices, share: Array, kept: Array) -> AnyBelief:
    """Of the L tracks, the mixture of the prediction and of the update with each detection.

    Of a filter with several motion models the mode probabilities are mixed, and each mode by the probability that a
    possibility has if the motion is that of the mode. Source: Houles and Bar-Shalom (1989), "Multisensor tracking of a
    maneuvering target in clutter", for one target; the association probabilities are here those of all.
    """
    before = bare(at.belief)
    if not len(track):
        return before
    updated = updates(at, track, detection)
    if isinstance(before, Belief):
        assert isinstance(updated, Belief)
        return _one_model(before, updated, at.filter.motions[0].angular, track, share, kept)
    assert isinstance(updated, MultiModelBelief)
    assert isinstance(before, MultiModelBelief)
    missed, hit = kept * before.probability, share * updated.probability
    probability = np.stack([np.bincount(track, each, len(kept)) for each in hit]) + missed
    probability = np.maximum(probability, LEAST)
    modes = [
        _one_model(one, other, motion.angular, track, hit[j] / probability[j, track], missed[j] / probability[j])
        for j, (motion, one, other) in enumerate(zip(at.filter.motions, before.modes, updated.modes, strict=True))
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def _one_model(
    before: Belief, updated: Belief, angular: tuple[int, ...], track: Indices, share: Array, kept: Array
) -> Belief:
    """For a gain that is the same for each detection this is the usual covariance with the spread of the innovations.

    Args:
        before: ``(n, L)`` the predictions.
        updated: ``(n, P)`` of each pair.
        angular: which components are angles.
        track: ``(P,)`` ascending.
        share: ``(P,)`` the probability of each pair.
        kept: ``(L,)`` the probability that there was no detection.
    """
    mean, covariance = before.mean.copy(), before.covariance.copy()
    offset = difference(updated.mean, mean[:, track], angular)
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    own = track[begins]
    shift = np.add.reduceat(share * offset, begins, axis=-1)
    spread = share * (updated.covariance + offset[:, None] * offset[None])
    spread = np.add.reduceat(spread, begins, axis=-1) - shift[:, None] * shift[None]
    mean[:, own] = wrap_components(mean[:, own] + shift, angular)
    covariance[..., own] = linalg.symmetrise(kept[own] * covariance[..., own] + spread)
    return Belief(mean, covariance)


def _largest(track: Indices, detection: Indices, share: Array, none: Array) -> Indices:
    """``(L,)`` the detection of the largest share of each track, -1 where none is likelier."""
    used, largest = np.full(len(none), NONE), none.copy()
    # The last of several writes to the same place stays.
    order = np.argsort(share, kind="stable")
    order = order[share[order] > largest[track[order]]]
    used[track[order]] = detection[order]
    return used

"""Association that weighs all possibilities: each track takes the mean of what it would be with each detection."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.engine.equations import Compute, by_numpy
from trackbench.trackers.multi.gate import GatedPairs
from trackbench.trackers.multi.hard import Association, AssociationInput
from trackbench.trackers.multi.marginals import marginals
from trackbench.trackers.multi.table import NONE


def weighed(
    at: AssociationInput,
    pairs: GatedPairs,
    existence: Array | None,
    density: float,
    max_cluster: int,
    compute: Compute = by_numpy,
) -> Association:
    """Joint probabilistic data association, with or without existence probabilities.

    Source: Fortmann, Bar-Shalom and Scheffe (1983), "Sonar tracking of multiple targets using joint probabilistic
    data association"; with existence Musicki and Evans (2004), "Joint integrated probabilistic data association:
    JIPDA", and Williams (2015), "Marginal multi-Bernoulli filters", equations 36 to 52, whose Bernoulli components are
    the same.

    Args:
        at: the situation.
        pairs: in the gates, sorted by track.
        existence: ``(2, L)`` predicted probability that the object exists, and that it is not hidden if so; None: both
            are certain.
        density: of detections that stem from none of the tracks.
        max_cluster: size of cluster up to which the association probabilities are exact.
        compute: how equations are computed.
    """
    track, detection = pairs.track, pairs.detection
    count, detections = len(at.run), len(at.detections.run)
    exists, visible = np.ones((2, count)) if existence is None else existence
    hit = exists[track] * at.detection_probability[track] * np.exp(pairs.log_likelihood) / density
    missed_existing, unseen = exists * at.miss, 1.0 - exists + exists * at.miss
    share = marginals(track, detection, hit / unseen[track], (count, detections), max_cluster, compute)
    none = np.maximum(1.0 - np.bincount(track, share, count), 0.0)
    kept = none * missed_existing / unseen
    after = np.minimum(kept + np.bincount(track, share, count), 1.0)
    belief = at.filter.mixture(at.expected, at.detections.scan, track, detection, share / after[track], kept / after)
    unclaimed = np.maximum(1.0 - np.bincount(detection, share, detections), 0.0)
    # Of an object that exists and was missed.
    still_visible = 1.0 - (1.0 - visible) / at.miss
    visible = (after - kept + kept * still_visible) / after
    ratio = np.log(unseen + np.bincount(track, hit, count))
    used = _largest(track, detection, share, none)
    return Association(belief, used, unclaimed, ratio, None if existence is None else np.array([after, visible]))


def _largest(track: Indices, detection: Indices, share: Array, none: Array) -> Indices:
    """``(L,)`` the detection of the largest share of each track, -1 where none is likelier."""
    used, largest = np.full(len(none), NONE), none.copy()
    np.maximum.at(largest, track, share)
    # The last of several writes to the same place stays.
    which = np.flatnonzero((share == largest[track]) & (share > none[track]))
    used[track[which]] = detection[which]
    return used

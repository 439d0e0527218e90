"""Which detections are taken to stem from which tracks, by the method that the options name."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trackbench.base.distributions import chi_square_quantile
from trackbench.base.types import Indices, Mask
from trackbench.engine.equations import Compute
from trackbench.filters import MultiModelBelief, choose
from trackbench.trackers.associate import EXISTENCE, AssociateConfig
from trackbench.trackers.multi.assign import best_assignment, in_order_of_list, of_same_object
from trackbench.trackers.multi.gate import GatedPairs, gated, under_modes
from trackbench.trackers.multi.hard import Association, AssociationInput, decided, missed
from trackbench.trackers.multi.soft import weighed
from trackbench.trackers.multi.table import NONE, TrackTable

#: A detection that is less likely than this to stem from a track is free, where tracks have no existence.
CLAIMED = 0.5
#: Smallest detection probability that a tracker reckons with where there is a detection.
LEAST_DETECTION = 1e-3


def associated(
    config: AssociateConfig,
    at: AssociationInput,
    table: TrackTable,
    origin: Indices | None,
    probability: float,
    compute: Compute,
) -> Association:
    """What becomes of the tracks and the detections.

    Args:
        config: the options.
        at: the situation, whose detection probabilities are corrected.
        table: the tracks.
        origin: ``(N,)`` number of the object that caused each detection, for the oracle.
        probability: that an object in view is detected.
        compute: how equations are computed.
    """
    if config.method == "oracle":
        assert origin is not None
        return _by_origin(at, table.origin, origin)
    measured = at.filter.measured(at.detections.scan)
    belief, predicted, _ = at.expected
    threshold = _threshold(config.gate, len(measured.value))
    pairs = gated(predicted, measured, at.detections, at.run, threshold, compute, at.filter.close)
    if isinstance(belief, MultiModelBelief):
        pairs = under_modes(pairs, predicted, measured, belief.probability, compute)
    # What is in a gate was in view, whatever the sensor states.
    at.detection_probability[pairs.track] = max(probability, LEAST_DETECTION)
    if config.method in EXISTENCE:
        at.detection_probability[:] *= table.evidence[1]
    if config.method == "naive":
        chosen = in_order_of_list(pairs)
        return decided(at, pairs.track[chosen], pairs.detection[chosen], np.zeros(len(chosen)))
    if config.method == "gnn":
        return _nearest(at, pairs)
    density = at.intensity.false_alarms
    if config.method == "jpda":
        return _established(at, pairs, table.id != NONE, density, config.max_cluster, compute)
    if config.method == "pmb":
        density += at.intensity.new_objects * probability
    return weighed(at, pairs, table.evidence, density, config.max_cluster, compute)


def _nearest(at: AssociationInput, pairs: GatedPairs) -> Association:
    probability = at.detection_probability.take(pairs.track)
    ratio = np.log(probability / at.intensity.false_alarms) + pairs.log_likelihood
    chosen = best_assignment(pairs, ratio - np.log(missed(probability, at.gate)), at.run)
    return decided(at, pairs.track[chosen], pairs.detection[chosen], ratio[chosen])


def _established(
    at: AssociationInput, pairs: GatedPairs, confirmed: Mask, density: float, max_cluster: int, compute: Compute
) -> Association:
    """JPDA takes each object to exist, which is known of confirmed tracks; the others take the nearest of the rest.

    A tentative track that shares would keep much of its first covariance, and find a false alarm in its wide gate
    again and again.
    """
    shared = confirmed[pairs.track]
    first = weighed(at, pairs.select(shared), None, density, max_cluster, compute)
    rest = pairs.select(~shared & (first.unclaimed[pairs.detection] > CLAIMED))
    second = _nearest(at, rest)
    return Association(
        choose(confirmed, first.belief, second.belief),
        np.where(confirmed, first.detection, second.detection),
        np.minimum(first.unclaimed, second.unclaimed),
        np.where(confirmed, first.log_ratio, second.log_ratio),
    )


@lru_cache(maxsize=64)
def _threshold(gate: float, components: int) -> float:
    """The squared Mahalanobis distance that a detection of the object exceeds with probability ``1 - gate``."""
    return float(chi_square_quantile(gate, components))


def _by_origin(at: AssociationInput, of_track: Indices, of_detection: Indices) -> Association:
    objects = int(max(of_track.max(initial=-1), of_detection.max(initial=-1))) + 1
    detection = np.where(of_detection >= 0, at.detections.run * objects + of_detection, NONE)
    track, taken = of_same_object(at.run * objects + of_track, detection)
    return decided(at, track, taken, np.zeros(len(track)))

"""Which detections are taken to stem from which tracks, and which tracks follow the same object."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from trackbench.base.types import Array, Indices, Mask, indices
from trackbench.engine.equations import Compute, by_numpy
from trackbench.filters import AnyBelief, Measured, MultiModelBelief, choose
from trackbench.trackers.associate import EXISTENCE, AssociateConfig
from trackbench.trackers.multi.gate import GatedPairs, RunDetections, gated, under_modes
from trackbench.trackers.multi.intensity import Intensity
from trackbench.trackers.multi.mixture import marginals
from trackbench.trackers.multi.table import NONE, PredictedTracks, TrackFilter, TrackTable, by_run

#: Most tracks of a cluster, or detections if these are fewer, whose association probabilities are exact; loopy belief
#: propagation finds those of larger clusters.
MAX_CLUSTER = 6


class AssociationInput(NamedTuple):
    """The tracks and the detections of a scan, before they are associated."""

    filter: TrackFilter
    expected: PredictedTracks
    """Of the L tracks."""
    detections: RunDetections
    measured: Measured
    run: Indices
    """``(L,)``"""
    detection_probability: Array
    """``(L,)`` of an object where the track says; 0 outside the field of view, less where it may be hidden."""
    gate: float
    """Probability that a detection falls into the gate."""
    intensity: Intensity

    @property
    def miss(self) -> Array:
        """``(L,)`` probability that an object that exists has no detection in its gate."""
        return 1.0 - self.detection_probability * self.gate


class Association(NamedTuple):
    """Result of an association: beliefs of the tracks, and which detections are theirs."""

    belief: AnyBelief
    """Of the L tracks."""
    detection: Indices
    """``(L,)`` the most probable one; -1 for none."""
    unclaimed: Array
    """``(N,)`` probability that a detection stems from none of the tracks."""
    log_ratio: Array
    """``(L,)`` logarithm of the likelihood of the detections with an object, over that without."""
    existence: Array | None = None
    """``(2, L)`` probability that the object exists, and that it is not hidden if so, where the method has them."""


def decided(at: AssociationInput, track: Indices, detection: Indices, log_ratio: Array) -> Association:
    """Each of the tracks takes its detection; the others keep their prediction.

    Args:
        at: the situation.
        track, detection: ``(P,)`` the pairs, each track at most once.
        log_ratio: ``(P,)`` logarithm of the likelihood ratio of each.
    """
    of_track, unclaimed = np.zeros(len(at.run), dtype=np.intp), np.zeros(len(at.detections.run))
    of_track += NONE
    unclaimed += 1.0
    of_track[track], unclaimed[detection] = detection, 0.0
    ratio = np.log(at.miss)
    ratio[track] = log_ratio
    belief = at.filter.taken_in(at.expected, at.detections.scan, of_track)
    return Association(belief, of_track, unclaimed, ratio)


def weighed(
    at: AssociationInput,
    pairs: GatedPairs,
    existence: Array | None,
    density: float | Array,
    compute: Compute = by_numpy,
    negligible: float = 0.0,
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
        density: of detections that stem from none of the tracks; ``(N,)`` where each is.
        compute: how equations are computed.
        negligible: pairs of no more weight (the probability of the pair over that of neither being associated) are
            left out. The weight bounds a pair's association probability, and the sum of those that are left out in a
            cluster by how much any probability in it changes.
    """
    track, detection = pairs.track, pairs.detection
    count, detections = len(at.run), len(at.detections.run)
    rest = density.take(detection) if isinstance(density, np.ndarray) else density
    exists, visible = np.ones((2, count)) if existence is None else existence
    miss = at.miss
    hit = exists.take(track) * at.detection_probability.take(track) * np.exp(pairs.log_likelihood) / rest
    missed_existing = exists * miss
    unseen = 1.0 - exists + missed_existing
    weight = hit / unseen.take(track)
    if negligible:
        index = indices(weight > negligible)
        track, detection, weight, hit = (values.take(index) for values in (track, detection, weight, hit))
    share = marginals(track, detection, weight, (count, detections), MAX_CLUSTER, compute)
    shared = np.bincount(track, share, count)
    none = np.maximum(1.0 - shared, 0.0)
    kept = none * missed_existing / unseen
    after = np.minimum(kept + shared, 1.0)
    belief = at.filter.mixture(
        at.expected, at.detections.scan, track, detection, share / after.take(track), kept / after
    )
    unclaimed = np.maximum(1.0 - np.bincount(detection, share, detections), 0.0)
    # Of an object that exists and was missed.
    still_visible = 1.0 - (1.0 - visible) / miss
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


def best_assignment(row: Indices, column: Indices, weight: Array, group: Indices) -> Indices:
    """Return the pairs, each row and each column in at most one, whose weights have the largest sum.

    Args:
        row, column: ``(P,)`` of each pair; numbers that differ between groups.
        weight: ``(P,)``; a pair of negative weight is never taken.
        group: ``(P,)`` of each pair.
    """
    rest = (weight > 0.0).nonzero()[0]
    taken: list[Indices] = []
    while len(rest):
        # What outweighs all its rivals together is in every best assignment.
        rows, columns, own = row[rest], column[rest], weight[rest]
        of_row, of_column = np.bincount(rows, own), np.bincount(columns, own)
        sure = 3.0 * own > of_row[rows] + of_column[columns]
        if not sure.any():
            rest = by_run(rest, group)
            parts = np.split(rest, indices(np.diff(group[rest])) + 1)
            taken += [part[assigned(row[part], column[part], weight[part])] for part in parts]
            break
        of_row[rows[sure]] = of_column[columns[sure]] = 0.0
        taken.append(rest[sure])
        rest = rest[(of_row[rows] > 0.0) & (of_column[columns] > 0.0)]
    return np.sort(np.concatenate(taken)) if len(taken) > 1 else (taken or [rest])[0]


def assigned(row: Indices, column: Indices, weight: Array) -> Mask:
    """``(P,)`` the same of the pairs of one group, whose weights are above zero, as a mask."""
    # A run with known identities does without the .3 s of this import.
    from scipy.optimize import linear_sum_assignment

    # Of a few numbers this is many times as quick as np.unique.
    rows = {number: place for place, number in enumerate(sorted({*row.tolist()}))}
    columns = {number: place for place, number in enumerate(sorted({*column.tolist()}))}
    i, j = [rows[number] for number in row.tolist()], [columns[number] for number in column.tolist()]
    matrix = np.zeros((len(rows), len(columns)))
    matrix[i, j] = weight
    partner = np.full(len(rows), -1)
    first, second = linear_sum_assignment(matrix, maximize=True)
    partner[first] = second
    return np.asarray(partner[i] == j)


def in_order_of_list(pairs: GatedPairs) -> Indices:
    """Each detection, in the order of the list, with the nearest track that has none yet."""
    taken_tracks, taken_detections, taken = set(), set(), []
    for pair in np.lexsort((pairs.distance, pairs.detection)):
        track, detection = pairs.track[pair], pairs.detection[pair]
        if track not in taken_tracks and detection not in taken_detections:
            taken_tracks.add(track)
            taken_detections.add(detection)
            taken.append(pair)
    return np.sort(np.array(taken, dtype=np.intp))


def of_same_object(track: Indices, detection: Indices) -> tuple[Indices, Indices]:
    """Tracks and detections of the same object.

    Args:
        track: ``(L,)`` a number for the run and object of each track.
        detection: ``(N,)`` the same of each detection; negative for false alarms.
    """
    order = np.argsort(detection, kind="stable")
    place = np.searchsorted(detection[order], track)
    result = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(0, dtype=np.intp)
    same = indices(detection[result] == track) if len(order) else result
    return same, result[same]


#: A detection that is less likely than this to stem from a track is free, where tracks have no existence.
CLAIMED = 0.5
#: Weight up to which ``pmb`` leaves a pair out: its clusters are then those of pairs that matter.
NEGLIGIBLE = 1e-4
#: Smallest detection probability that a tracker reckons with where there is a detection.
LEAST_DETECTION = 1e-3


def associated(
    config: AssociateConfig,
    at: AssociationInput,
    table: TrackTable,
    origin: Indices | None,
    probability: float | Array,
    compute: Compute,
) -> Association:
    """Associate the detections of a scan with the tracks.

    Args:
        config: the options.
        at: the situation, whose detection probabilities are corrected.
        table: the tracks.
        origin: ``(2, N)`` numbers of the objects that caused each detection, for the oracle.
        probability: that an object is detected where it is in view, ``(L,)`` if it differs.
        compute: how equations are computed.
    """
    if config.method == "oracle":
        assert origin is not None
        objects = int(max(table.origin.max(initial=-1), origin.max(initial=-1))) + 1
        caused = np.where(origin >= 0, at.detections.run * objects + origin, NONE)
        track, place = of_same_object(at.run * objects + table.origin, caused.reshape(-1))
        return decided(at, track, place % max(1, origin.shape[1]), np.zeros(len(track)))
    (belief, predicted, _), measured = at.expected, at.measured
    threshold = gate_threshold(config.gate, len(measured.value))
    pairs = gated(predicted, measured, at.detections, at.run, threshold, compute)
    if isinstance(belief, MultiModelBelief):
        pairs = under_modes(pairs, predicted, measured, belief.probability, compute)
    # What is in a gate was in view, whatever the sensor states.
    own = probability.take(pairs.track) if isinstance(probability, np.ndarray) else probability
    at.detection_probability[pairs.track] = np.maximum(own, LEAST_DETECTION)
    if config.method in EXISTENCE:
        at.detection_probability[:] *= table.evidence[1]
    if config.method == "naive":
        chosen = in_order_of_list(pairs)
        return decided(at, pairs.track[chosen], pairs.detection[chosen], np.zeros(len(chosen)))
    if config.method == "gnn":
        return _nearest(at, pairs)
    density = at.intensity.false_alarms
    if config.method == "jpda":
        return _established(at, pairs, table.id != NONE, density, compute)
    if config.method == "jipda":
        return weighed(at, pairs, table.evidence[:2], density, compute)
    both = density + at.intensity.new_objects
    return weighed(at, pairs, table.evidence[:2], both, compute, NEGLIGIBLE)


def _nearest(at: AssociationInput, pairs: GatedPairs) -> Association:
    probability = at.detection_probability.take(pairs.track)
    ratio = np.log(probability / at.intensity.false_alarms) + pairs.log_likelihood
    weight = ratio - np.log(1.0 - probability * at.gate)
    chosen = best_assignment(pairs.track, pairs.detection, weight, at.run.take(pairs.track))
    return decided(at, pairs.track[chosen], pairs.detection[chosen], ratio[chosen])


def _established(
    at: AssociationInput, pairs: GatedPairs, confirmed: Mask, density: float, compute: Compute
) -> Association:
    """JPDA takes each object to exist, which is known of confirmed tracks; the others take the nearest of the rest.

    A tentative track that shares would keep much of its first covariance, and find a false alarm in its wide gate
    again and again.
    """
    shared = confirmed[pairs.track]
    first = weighed(at, pairs.select(shared), None, density, compute)
    rest = pairs.select(~shared & (first.unclaimed[pairs.detection] > CLAIMED))
    second = _nearest(at, rest)
    return Association(
        choose(confirmed, first.belief, second.belief),
        np.where(confirmed, first.detection, second.detection),
        np.minimum(first.unclaimed, second.unclaimed),
        np.where(confirmed, first.log_ratio, second.log_ratio),
    )


@lru_cache(maxsize=64)
def gate_threshold(gate: float, components: int) -> float:
    """The squared Mahalanobis distance that a detection of the object exceeds with probability ``1 - gate``."""
    return float(2 * gammaincinv(components / 2, gate))

"""Association of detections with tracks."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from trackbench.base.types import Array, Indices, Mask, indices
from trackbench.engine.equations import Compute, by_numpy
from trackbench.filters import AnyBelief, Measured, MultiModelBelief, choose
from trackbench.trackers.associate import EXISTENCE, AssociateConfig
from trackbench.trackers.multi.gate import GatedPairs, RunDetections, gated, with_mode_likelihoods
from trackbench.trackers.multi.intensity import Intensity
from trackbench.trackers.multi.mixture import marginals
from trackbench.trackers.multi.table import NONE, PredictedTracks, TrackFilter, TrackTable, sorted_by_run

#: Largest number of tracks (or detections, if fewer) of a cluster whose association probabilities are computed exactly;
#: larger clusters use loopy belief propagation.
MAX_CLUSTER = 6


class AssociationInput(NamedTuple):
    """Predicted tracks, and detections of a scan, before their association."""

    filter: TrackFilter
    expected: PredictedTracks
    detections: RunDetections
    measured: Measured
    run: Indices
    """Run ``(L,)`` of each track, as an index in the batch of runs."""
    detection_probability: Array
    """P_D ``(L,)`` of each track; 0 outside the field of view, less if the object may be hidden."""
    gate: float
    """Probability that an object's detection falls into the gate of its track."""
    intensity: Intensity

    @property
    def miss(self) -> Array:
        """Probability ``(L,)`` that an existing object has no detection in its gate."""
        return 1.0 - self.detection_probability * self.gate


class Association(NamedTuple):
    """Result of an association: updated beliefs of the tracks, and the detection of each track."""

    belief: AnyBelief
    detection: Indices
    """Index ``(L,)`` of the most probable detection of each track; -1 for none."""
    unclaimed: Array
    """Probability ``(N,)`` that a detection stems from no existing track."""
    log_ratio: Array
    """Log-likelihood ratio ``(L,)`` of the detections with the track's object to the detections without it."""
    existence: Array | None = None
    """Probabilities ``(2, L)`` that each of L tracks exists and that it is visible if it exists; None without them."""


def hard_association(inputs: AssociationInput, track: Indices, detection: Indices, log_ratio: Array) -> Association:
    """Update each track of a pair with the pair's detection; keep the prediction of other tracks.

    Args:
        inputs: tracks and detections.
        track: index ``(P,)`` of each pair's track; no track has two pairs.
        detection: index ``(P,)`` of each pair's detection.
        log_ratio: log-likelihood ratio ``(P,)`` of each pair.
    """
    detection_of_track, unclaimed = np.zeros(len(inputs.run), dtype=np.intp), np.zeros(len(inputs.detections.run))
    detection_of_track += NONE
    unclaimed += 1.0
    detection_of_track[track], unclaimed[detection] = detection, 0.0
    track_log_ratio = np.log(inputs.miss)
    track_log_ratio[track] = log_ratio
    belief = inputs.filter.updated_tracks(inputs.expected, inputs.detections.scan, detection_of_track)
    return Association(belief, detection_of_track, unclaimed, track_log_ratio)


def soft_association(
    inputs: AssociationInput,
    pairs: GatedPairs,
    existence: Array | None,
    density: float | Array,
    compute: Compute = by_numpy,
    negligible: float = 0.0,
) -> Association:
    """Update each track with the mixture of its possible detections (JPDA, or JIPDA with ``existence``).

    Source: Fortmann, Bar-Shalom and Scheffe (1983), "Sonar tracking of multiple targets using joint probabilistic data
    association"; with existence Musicki and Evans (2004), "Joint integrated probabilistic data association: JIPDA", and
    Williams (2015), "Marginal multi-Bernoulli filters", equations 36 to 52, with the same components.

    Args:
        inputs: tracks and detections.
        pairs: gated pairs, sorted by track.
        existence: ``(2, L)`` predicted probabilities of existence and, given existence, of being visible; None if every
            object exists.
        density: density of detections that stem from no track, ``(N,)`` if it differs between detections.
        compute: engine of the equations.
        negligible: largest weight of pairs that are left out. A weight is a pair's odds against leaving both
            unassociated. It bounds the pair's association probability; the sum over a cluster bounds the error.
    """
    track, detection = pairs.track, pairs.detection
    count, detections = len(inputs.run), len(inputs.detections.run)
    other_density = density.take(detection) if isinstance(density, np.ndarray) else density
    exists, visible = np.ones((2, count)) if existence is None else existence
    miss = inputs.miss
    hit = exists.take(track) * inputs.detection_probability.take(track) * np.exp(pairs.log_likelihood) / other_density
    missed_existence = exists * miss
    miss_likelihood = 1.0 - exists + missed_existence
    weight = hit / miss_likelihood.take(track)
    if negligible:
        index = indices(weight > negligible)
        track, detection, weight, hit = (values.take(index) for values in (track, detection, weight, hit))
    share = marginals(track, detection, weight, (count, detections), MAX_CLUSTER, compute)
    shared = np.bincount(track, share, count)
    no_detection = np.maximum(1.0 - shared, 0.0)
    missed_share = no_detection * missed_existence / miss_likelihood
    after = np.minimum(missed_share + shared, 1.0)
    belief = inputs.filter.mixture(
        inputs.expected, inputs.detections.scan, track, detection, share / after.take(track), missed_share / after
    )
    unclaimed = np.maximum(1.0 - np.bincount(detection, share, detections), 0.0)
    # Visibility of an existing object that was missed.
    visible_if_missed = 1.0 - (1.0 - visible) / miss
    visible = (after - missed_share + missed_share * visible_if_missed) / after
    ratio = np.log(miss_likelihood + np.bincount(track, hit, count))
    used = _most_probable(track, detection, share, no_detection)
    return Association(belief, used, unclaimed, ratio, None if existence is None else np.array([after, visible]))


def _most_probable(track: Indices, detection: Indices, share: Array, none: Array) -> Indices:
    used, largest = np.full(len(none), NONE), none.copy()
    np.maximum.at(largest, track, share)
    # For equal shares the last detection stays.
    which = np.flatnonzero((share == largest[track]) & (share > none[track]))
    used[track[which]] = detection[which]
    return used


def best_assignment(row: Indices, column: Indices, weight: Array, group: Indices) -> Indices:
    """Return the indices of the pairs with the largest sum of weights; each row and each column is used at most once.

    Args:
        row: ``(P,)`` row of each pair, such as its track; no two groups share a row.
        column: ``(P,)`` column of each pair, such as its detection; no two groups share a column.
        weight: weight ``(P,)`` of each pair; a pair of negative weight is never taken.
        group: ``(P,)`` group of each pair.
    """
    rest = (weight > 0.0).nonzero()[0]
    taken: list[Indices] = []
    while len(rest):
        # A pair that outweighs all its rivals together is in every best assignment.
        rows, columns, pair_weight = row[rest], column[rest], weight[rest]
        row_weight, column_weight = np.bincount(rows, pair_weight), np.bincount(columns, pair_weight)
        is_sure = 3.0 * pair_weight > row_weight[rows] + column_weight[columns]
        if not is_sure.any():
            rest = sorted_by_run(rest, group)
            parts = np.split(rest, indices(np.diff(group[rest])) + 1)
            taken += [part[assigned(row[part], column[part], weight[part])] for part in parts]
            break
        row_weight[rows[is_sure]] = column_weight[columns[is_sure]] = 0.0
        taken.append(rest[is_sure])
        rest = rest[(row_weight[rows] > 0.0) & (column_weight[columns] > 0.0)]
    return np.sort(np.concatenate(taken)) if len(taken) > 1 else (taken or [rest])[0]


def assigned(row: Indices, column: Indices, weight: Array) -> Mask:
    """Return a mask ``(P,)`` of the pairs in the best assignment of one group of pairs with positive weights."""
    # Only hidden identities need this import, which takes .3 s.
    from scipy.optimize import linear_sum_assignment

    # For few numbers this is many times faster than np.unique.
    rows = {number: place for place, number in enumerate(sorted({*row.tolist()}))}
    columns = {number: place for place, number in enumerate(sorted({*column.tolist()}))}
    i, j = [rows[number] for number in row.tolist()], [columns[number] for number in column.tolist()]
    matrix = np.zeros((len(rows), len(columns)))
    matrix[i, j] = weight
    partner = np.full(len(rows), -1)
    first, second = linear_sum_assignment(matrix, maximize=True)
    partner[first] = second
    return np.asarray(partner[i] == j)


def naive_assignment(pairs: GatedPairs) -> Indices:
    """Give each detection, in the scan's order, to the nearest track that has none yet; return indices of pairs."""
    taken_tracks, taken_detections, taken = set(), set(), []
    for pair in np.lexsort((pairs.distance, pairs.detection)):
        track, detection = pairs.track[pair], pairs.detection[pair]
        if track not in taken_tracks and detection not in taken_detections:
            taken_tracks.add(track)
            taken_detections.add(detection)
            taken.append(pair)
    return np.sort(np.array(taken, dtype=np.intp))


def same_object_pairs(track: Indices, detection: Indices) -> tuple[Indices, Indices]:
    """Return the pairs of a track and a detection of the same object and run, as indices.

    Args:
        track: ``(L,)`` number of each track's run and object.
        detection: ``(N,)`` number of each detection's run and object; negative for false alarms.
    """
    order = np.argsort(detection, kind="stable")
    place = np.searchsorted(detection[order], track)
    result = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(0, dtype=np.intp)
    matched = indices(detection[result] == track) if len(order) else result
    return matched, result[matched]


#: Least probability of stemming from no track at which a detection may start one, without existence probabilities.
CLAIMED = 0.5
#: Largest weight of pairs that ``pmb`` leaves out, which keeps its clusters small.
NEGLIGIBLE = 1e-4
#: Smallest P_D assumed for a track with a detection in its gate.
LEAST_DETECTION = 1e-3


def associated(
    config: AssociateConfig,
    inputs: AssociationInput,
    table: TrackTable,
    origin: Indices | None,
    probability: float | Array,
    compute: Compute,
) -> Association:
    """Associate the detections of a scan with the tracks, by the method in the options.

    Args:
        config: options of the association.
        inputs: tracks and detections; its detection probabilities are corrected in place.
        table: the tracks.
        origin: numbers ``(2, N)`` of the objects that caused each detection, for the oracle only.
        probability: P_D of an object in the field of view, ``(L,)`` if it differs between tracks.
        compute: engine of the equations.
    """
    if config.method == "oracle":
        assert origin is not None
        objects = int(max(table.origin.max(initial=-1), origin.max(initial=-1))) + 1
        caused = np.where(origin >= 0, inputs.detections.run * objects + origin, NONE)
        track, place = same_object_pairs(inputs.run * objects + table.origin, caused.reshape(-1))
        return hard_association(inputs, track, place % max(1, origin.shape[1]), np.zeros(len(track)))
    (belief, predicted, _), measured = inputs.expected, inputs.measured
    threshold = gate_threshold(config.gate, len(measured.value))
    pairs = gated(predicted, measured, inputs.detections, inputs.run, threshold, compute)
    if isinstance(belief, MultiModelBelief):
        pairs = with_mode_likelihoods(pairs, predicted, measured, belief.probability, compute)
    # A track with a detection in its gate was in view, whatever the field of view says.
    track_probability = probability.take(pairs.track) if isinstance(probability, np.ndarray) else probability
    inputs.detection_probability[pairs.track] = np.maximum(track_probability, LEAST_DETECTION)
    if config.method in EXISTENCE:
        inputs.detection_probability[:] *= table.evidence[1]
    if config.method == "naive":
        chosen = naive_assignment(pairs)
        return hard_association(inputs, pairs.track[chosen], pairs.detection[chosen], np.zeros(len(chosen)))
    if config.method == "gnn":
        return _global_nearest_neighbour(inputs, pairs)
    density = inputs.intensity.false_alarms
    if config.method == "jpda":
        return _jpda_of_confirmed(inputs, pairs, table.id != NONE, density, compute)
    if config.method == "jipda":
        return soft_association(inputs, pairs, table.evidence[:2], density, compute)
    total_density = density + inputs.intensity.new_objects
    return soft_association(inputs, pairs, table.evidence[:2], total_density, compute, NEGLIGIBLE)


def _global_nearest_neighbour(inputs: AssociationInput, pairs: GatedPairs) -> Association:
    probability = inputs.detection_probability.take(pairs.track)
    ratio = np.log(probability / inputs.intensity.false_alarms) + pairs.log_likelihood
    weight = ratio - np.log(1.0 - probability * inputs.gate)
    chosen = best_assignment(pairs.track, pairs.detection, weight, inputs.run.take(pairs.track))
    return hard_association(inputs, pairs.track[chosen], pairs.detection[chosen], ratio[chosen])


def _jpda_of_confirmed(
    inputs: AssociationInput, pairs: GatedPairs, confirmed: Mask, density: float, compute: Compute
) -> Association:
    """Associate confirmed tracks by JPDA, then tentative tracks with the nearest of the remaining detections.

    JPDA assumes that each object exists. A tentative track that shared detections would keep much of its first
    covariance, and its wide gate would catch false alarms again and again.
    """
    is_shared = confirmed[pairs.track]
    first = soft_association(inputs, pairs.select(is_shared), None, density, compute)
    remaining = pairs.select(~is_shared & (first.unclaimed[pairs.detection] > CLAIMED))
    second = _global_nearest_neighbour(inputs, remaining)
    return Association(
        choose(confirmed, first.belief, second.belief),
        np.where(confirmed, first.detection, second.detection),
        np.minimum(first.unclaimed, second.unclaimed),
        np.where(confirmed, first.log_ratio, second.log_ratio),
    )


@lru_cache(maxsize=64)
def gate_threshold(gate: float, components: int) -> float:
    """Return the squared Mahalanobis distance that a true detection does not exceed with probability ``gate``."""
    return float(2 * gammaincinv(components / 2, gate))

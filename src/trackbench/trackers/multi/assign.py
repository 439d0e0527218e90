"""One detection for a track, one track for a detection."""

from __future__ import annotations

import numpy as np

from trackbench.base.scipy_functions import largest_assignment
from trackbench.base.types import Array, Indices, indices
from trackbench.trackers.multi.gate import GatedPairs


def best_assignment(pairs: GatedPairs, weight: Array, run: Indices) -> Indices:
    """Those pairs, each track and each detection in at most one, whose weights have the largest sum.

    Args:
        pairs: of all runs, sorted by track.
        weight: ``(P,)``; a pair of negative weight is never taken.
        run: ``(L,)`` of each track.
    """
    rest = indices(weight > 0.0)
    taken: list[Indices] = []
    while len(rest):
        # What outweighs all its rivals together is in every best assignment.
        track, detection, own = pairs.track[rest], pairs.detection[rest], weight[rest]
        of_track, of_detection = np.bincount(track, own), np.bincount(detection, own)
        sure = 3.0 * own > of_track[track] + of_detection[detection]
        if not sure.any():
            taken += _by_run(pairs, weight, run, rest)
            break
        of_track[track[sure]] = of_detection[detection[sure]] = 0.0
        taken.append(rest[sure])
        rest = rest[(of_track[track] > 0.0) & (of_detection[detection] > 0.0)]
    return np.sort(np.concatenate(taken)) if len(taken) > 1 else (taken or [rest])[0]


def _by_run(pairs: GatedPairs, weight: Array, run: Indices, which: Indices) -> list[Indices]:
    """The best assignment of some pairs, one run after the other."""
    taken = []
    for part in np.split(which, indices(np.diff(run[pairs.track[which]])) + 1):
        rows, row = np.unique(pairs.track[part], return_inverse=True)
        columns, column = np.unique(pairs.detection[part], return_inverse=True)
        value, index = np.zeros((len(rows), len(columns))), np.full((len(rows), len(columns)), -1)
        value[row, column], index[row, column] = weight[part], part
        chosen = index[largest_assignment(value)]
        taken.append(chosen[chosen >= 0])
    return taken


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
    found = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(0, dtype=np.intp)
    same = indices(detection[found] == track) if len(order) else found
    return same, found[same]

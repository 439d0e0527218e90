"""Association that takes one decision: each track takes one detection, or none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.filters import AnyBelief
from trackbench.trackers.multi.detections import RunDetections
from trackbench.trackers.multi.intensity import Intensity
from trackbench.trackers.multi.table import NONE
from trackbench.trackers.multi.track_filter import PredictedTracks, TrackFilter


class AssociationInput(NamedTuple):
    """The tracks and the detections of a scan, before they are associated."""

    filter: TrackFilter
    expected: PredictedTracks
    """Of the L tracks."""
    detections: RunDetections
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
        return missed(self.detection_probability, self.gate)


def missed(detection: Array, gate: float) -> Array:
    """The probability of no detection in the gate, by that of a detection and that of the gate to hold it."""
    return 1.0 - detection * gate


class Association(NamedTuple):
    """What became of the tracks and the detections."""

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
        track, detection: ``(P,)`` the pairs, each track and each detection at most once.
        log_ratio: ``(P,)`` logarithm of the likelihood ratio of each.
    """
    of_track, unclaimed = np.full(len(at.run), NONE), np.ones(len(at.detections.run))
    of_track[track], unclaimed[detection] = detection, 0.0
    ratio = np.log(at.miss)
    ratio[track] = log_ratio
    belief = at.filter.taken_in(at.expected, at.detections.scan, of_track)
    return Association(belief, of_track, unclaimed, ratio)

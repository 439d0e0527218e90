"""Association that takes one decision: each track takes one detection, or none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.filters import Belief, PredictedMeasurement, SingleModelFilter
from trackbench.multi.detections import RunDetections
from trackbench.multi.intensity import Intensity
from trackbench.multi.table import NONE
from trackbench.types import Array, Indices


class Situation(NamedTuple):
    """The tracks and the detections of a scan, before they are associated."""

    filter: SingleModelFilter
    belief: Belief
    """``(n, L)`` predicted to the scan."""
    predicted: PredictedMeasurement
    """``(m, L)``"""
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
        return 1.0 - self.detection_probability * self.gate


class Association(NamedTuple):
    """What became of the tracks and the detections."""

    mean: Array
    """``(n, L)``"""
    covariance: Array
    """``(n, n, L)``"""
    detection: Indices
    """``(L,)`` the most probable one; -1 for none."""
    unclaimed: Array
    """``(N,)`` probability that a detection stems from none of the tracks."""
    log_ratio: Array
    """``(L,)`` logarithm of the likelihood of the detections with an object, over that without."""
    existence: Array | None = None
    """``(2, L)`` probability that the object exists, and that it is not hidden if so, where the method has them."""


def decided(at: Situation, track: Indices, detection: Indices, log_ratio: Array) -> Association:
    """Each of the tracks takes its detection; the others keep their prediction.

    Args:
        at: the situation.
        track, detection: ``(P,)`` the pairs, each track and each detection at most once.
        log_ratio: ``(P,)`` logarithm of the likelihood ratio of each.
    """
    mean, covariance = at.belief.mean.copy(), at.belief.covariance.copy()
    of_track, unclaimed = np.full(len(at.run), NONE), np.ones(len(at.detections.run))
    of_track[track], unclaimed[detection] = detection, 0.0
    ratio = np.log(at.miss)
    if len(track):
        updated = updates(at, track, detection)
        mean[:, track], covariance[..., track] = updated.mean, updated.covariance
        ratio[track] = log_ratio
    return Association(mean, covariance, of_track, unclaimed, ratio)


def updates(at: Situation, track: Indices, detection: Indices) -> Belief:
    """``(n, P)`` the belief of each track after the detection that stands beside it."""
    belief = Belief(at.belief.mean[:, track], at.belief.covariance[..., track])
    predicted = PredictedMeasurement(*(part[..., track] for part in at.predicted))
    scan = at.detections.scan
    own = scan._replace(measurement=scan.measurement[:, detection], valid=scan.valid[detection])
    return at.filter.update(belief, own, predicted).belief

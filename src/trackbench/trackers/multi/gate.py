"""Which detections may stem from which tracks."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, FieldOfView, Indices, Mask, Scan, indices
from trackbench.base.units import difference, wrap_angle
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.filters import Measured, PredictedMeasurement
from trackbench.trackers.multi.close import close_pairs
from trackbench.trackers.multi.detections import RunDetections

#: Finds tracks and detections, sorted by both, among which are all that are in the gate; arguments as of ``gated``.
Close = Callable[[PredictedMeasurement, Measured, RunDetections, Indices, float], tuple[Indices, Indices]]


class GatedPairs(NamedTuple):
    """Tracks and detections of the same run that are in each other's gate, sorted by track and detection."""

    track: Indices
    """``(P,)``"""
    detection: Indices
    """``(P,)``"""
    distance: Array
    """``(P,)`` squared Mahalanobis distance."""
    log_likelihood: Array
    """``(P,)`` of the detection, if the track's object caused it."""

    def select(self, which: Mask) -> GatedPairs:
        """Some of the pairs."""
        index = indices(which)
        return GatedPairs._make(part.take(index) for part in self)


def gated(
    predicted: PredictedMeasurement,
    measured: Measured,
    detections: RunDetections,
    run: Indices,
    threshold: float,
    compute: Compute,
    close: Close,
) -> GatedPairs:
    """The pairs whose squared Mahalanobis distance is at most ``threshold``.

    Args:
        predicted: of each track, ``(m, L)``.
        measured: of each detection, ``(m, N)``.
        detections: of all runs.
        run: ``(L,)`` of each track.
        threshold: of chi-square with ``m`` degrees of freedom.
        compute: how equations are computed.
        close: how pairs are found among which those in the gate are.
    """
    track, detection = close(predicted, measured, detections, run, threshold)
    distance, log_likelihood = _likelihood(predicted, measured, track, detection, compute)
    return GatedPairs(track, detection, distance, log_likelihood).select(distance <= threshold)


def under_modes(
    pairs: GatedPairs,
    predicted: PredictedMeasurement,
    measured: Measured,
    prior: Array,
    compute: Compute = by_numpy,
) -> GatedPairs:
    """The pairs, their likelihood that of the mixture of the modes, whose probabilities are ``prior`` ``(M, L)``."""
    of_mode = [_likelihood(mode, measured, pairs.track, pairs.detection, compute)[1] for mode in predicted.modes]
    joint = np.log(prior[:, pairs.track]) + np.stack(of_mode)
    largest = joint.max(axis=0)
    return pairs._replace(log_likelihood=largest + np.log(np.exp(joint - largest).sum(axis=0)))


def _likelihood(
    predicted: PredictedMeasurement, measured: Measured, track: Indices, detection: Indices, compute: Compute
) -> tuple[Array, Array]:
    """``(P,)`` squared Mahalanobis distance and log-likelihood of each pair."""
    noise = measured.noise if measured.noise.ndim == 2 else measured.noise.take(detection, axis=-1)
    found = compute(
        _of_pair(measured.angular),
        {
            "value": measured.value.take(detection, axis=-1),
            "noise": noise,
            "expected": predicted.mean.take(track, axis=-1),
            "spread": predicted.covariance.take(track, axis=-1),
        },
    )
    return found["distance"], found["log_likelihood"]


@cache
def _of_pair(angular: tuple[int, ...]) -> Equations:
    """How far a detection is from a track, whatever the number of components."""

    def function(values: Values) -> Values:
        innovation = difference(values["value"], values["expected"], angular)
        spread = values["spread"]
        factor = linalg.cholesky(spread + linalg.expand(values["noise"], spread))
        whitened = factor.whiten(innovation)
        distance = np.einsum("i...,i...->...", whitened, whitened)
        return {"distance": distance, "log_likelihood": factor.log_density(whitened)}

    ranks = {"value": 1, "noise": 2, "expected": 1, "spread": 2}
    return Equations("distance of a detection from a track", function, ranks, frozenset({"spread"}), key=angular)


def close_in_one(
    predicted: PredictedMeasurement, measured: Measured, detections: RunDetections, run: Indices, threshold: float
) -> tuple[Indices, Indices]:
    """Pairs that are close in one component: a gate lies within the box about it, and that is quickly asked."""
    free = [i for i in range(len(measured.value)) if i not in measured.angular]
    axis = free[0] if free else 0
    noise = measured.noise[axis, axis]
    largest = noise if noise.ndim == 0 else noise.max(initial=0.0)
    reach = np.sqrt(threshold * (predicted.covariance[axis, axis] + largest))
    return close_pairs(predicted.mean[axis], reach, run, measured.value[axis], detections, angular=not free)


def in_view(position: Array, scan: Scan) -> Mask:
    """``(L,)`` which positions ``(2, L)`` are in the field of view of the sensor."""
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    dx, dy = position[0] - scan.sensor_pose[0], position[1] - scan.sensor_pose[1]
    seen: Mask = dx * dx + dy * dy <= view.max_range * view.max_range
    if view.half_angle < np.pi:
        seen &= np.abs(wrap_angle(np.arctan2(dy, dx) - scan.sensor_pose[2])) <= view.half_angle
    return seen

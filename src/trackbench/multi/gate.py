"""Which detections may stem from which tracks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.filters import Measured, PredictedMeasurement
from trackbench.multi.detections import RunDetections
from trackbench.types import Array, FieldOfView, Indices, Mask, Scan
from trackbench.units import difference, wrap_angle


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
        return GatedPairs(self.track[which], self.detection[which], self.distance[which], self.log_likelihood[which])


def gated(
    predicted: PredictedMeasurement, measured: Measured, detections: RunDetections, run: Indices, threshold: float
) -> GatedPairs:
    """The pairs whose squared Mahalanobis distance is at most ``threshold``.

    Args:
        predicted: of each track, ``(m, L)``.
        measured: of each detection, ``(m, N)``.
        detections: of all runs.
        run: ``(L,)`` of each track.
        threshold: of chi-square with ``m`` degrees of freedom.
    """
    track, detection = _close(predicted, measured, detections, run, threshold)
    distance, log_likelihood = _likelihood(predicted, measured, track, detection)
    return GatedPairs(track, detection, distance, log_likelihood).select(distance <= threshold)


def under_modes(pairs: GatedPairs, predicted: PredictedMeasurement, measured: Measured, prior: Array) -> GatedPairs:
    """The pairs, their likelihood that of the mixture of the modes, whose probabilities are ``prior`` ``(M, L)``."""
    of_mode = [_likelihood(mode, measured, pairs.track, pairs.detection)[1] for mode in predicted.modes]
    joint = np.log(prior[:, pairs.track]) + np.stack(of_mode)
    largest = joint.max(axis=0)
    return pairs._replace(log_likelihood=largest + np.log(np.exp(joint - largest).sum(axis=0)))


def _likelihood(
    predicted: PredictedMeasurement, measured: Measured, track: Indices, detection: Indices
) -> tuple[Array, Array]:
    """``(P,)`` squared Mahalanobis distance and log-likelihood of each pair."""
    innovation = difference(measured.value[:, detection], predicted.mean[:, track], measured.angular)
    noise = measured.noise[..., None] if measured.noise.ndim == 2 else measured.noise[..., detection]
    factor = linalg.cholesky(predicted.covariance[..., track] + noise)
    whitened = factor.whiten(innovation)
    distance = np.einsum("ip,ip->p", whitened, whitened)
    normalised = np.prod(factor.inverse_diagonal, axis=0) * (2 * np.pi) ** (-len(innovation) / 2)
    return distance, np.log(normalised) - 0.5 * distance


def _close(
    predicted: PredictedMeasurement, measured: Measured, detections: RunDetections, run: Indices, threshold: float
) -> tuple[Indices, Indices]:
    """Pairs that are close in one component: a gate lies within the box about it, and that is quickly asked."""
    free = [i for i in range(len(measured.value)) if i not in measured.angular]
    axis = free[0] if free else 0
    listed = np.full((len(detections.first), int(detections.rank.max(initial=-1)) + 1), np.nan)
    listed[detections.run, detections.rank] = measured.value[axis]
    noise = measured.noise[axis, axis].max(initial=0.0)
    reach = np.sqrt(threshold * (predicted.covariance[axis, axis] + noise))
    away = listed[run] - predicted.mean[axis][:, None]
    if not free:
        away = wrap_angle(away)
    track, rank = np.nonzero(np.abs(away) <= reach[:, None])
    return track, detections.first[run[track]] + rank


def in_view(position: Array, scan: Scan) -> Mask:
    """``(L,)`` which positions ``(2, L)`` are in the field of view of the sensor."""
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    dx, dy = position[0] - scan.sensor_pose[0], position[1] - scan.sensor_pose[1]
    seen = np.ones(dx.shape, dtype=bool)
    if np.isfinite(view.max_range):
        seen &= dx * dx + dy * dy <= view.max_range**2
    if view.half_angle < np.pi:
        seen &= np.abs(wrap_angle(np.arctan2(dy, dx) - scan.sensor_pose[2])) <= view.half_angle
    return seen

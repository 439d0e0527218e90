"""Which detections may stem from which tracks."""

from __future__ import annotations

from functools import cache
from operator import methodcaller
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, FieldOfView, Indices, Mask, Scan, with_sensor_of
from trackbench.base.units import difference, wrap_angle
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.filters import Measured, PredictedMeasurement


class RunDetections(NamedTuple):
    """The N detections of a scan of many runs, those of a run together."""

    scan: Scan
    """``measurement`` ``(m, N)``, ``valid`` ``(N,)``, all True."""
    run: Indices
    """``(N,)``"""
    column: Indices
    """``(N,)`` where each stands in the scan of its run."""
    first: Indices
    """``(runs + 1,)`` the first detection of each run, and ``N``."""


def run_detections(scan: Scan, as_listed: bool) -> RunDetections:
    """The detections of a scan ``(m, D, runs)`` without its padding.

    Within a run they stand as listed, or sorted by their values, so that the order of the list changes nothing.
    """
    most, runs = scan.valid.shape
    flat = scan.measurement.reshape(len(scan.measurement), -1)
    first = np.zeros(runs + 1, dtype=np.intp)
    counts = scan.valid.sum(axis=0)
    counts.cumsum(out=first[1:])
    run = np.arange(runs).repeat(counts)
    place = (scan.valid.T.ravel().nonzero()[0] - run * most) * runs + run
    measurement = flat.take(place, axis=1)
    if not as_listed and len(run):
        order = _order(measurement, run)
        place, measurement = place[order], measurement.take(order, axis=1)
    alone = with_sensor_of(scan, run, measurement=measurement, valid=place >= 0)
    return RunDetections(alone, run, place // runs, first)


TINY = float(np.finfo(float).tiny)


def _order(measurement: Array, run: Indices) -> Indices:
    """How detections ``(m, N)`` stand that are sorted by their run, then by their values."""
    key = measurement[0]
    if run[-1]:
        # One number for both: the first component falls short of 1.
        lowest = key.min()
        spread = key.max() - lowest
        key = run + (key - lowest) / max(2.0 * spread, TINY)
    # In any order of those alike, which is the quickest; what is alike, or no number, is told apart by all components.
    order: Indices = key.argsort()
    ranked = key[order]
    return order if (ranked[1:] > ranked[:-1]).all() else np.lexsort((*measurement[::-1], run))


def close_pairs(
    mean: Array, reach: Array, run: Indices, value: Array, detections: RunDetections, angular: bool
) -> tuple[Indices, Indices]:
    """Tracks and detections of the same run, sorted by both, that are not farther apart than the track's reach.

    Args:
        mean, reach: ``(L,)`` of the component, for each track.
        run: ``(L,)`` of each track.
        value: ``(N,)`` of the component, for each detection.
        detections: of all runs.
        angular: whether the component is an angle.
    """
    first = detections.first
    rank = np.arange(len(value)) - first[detections.run]
    most = int(rank.max(initial=-1)) + 1
    listed = np.empty((len(first) - 1, most))
    listed.fill(np.nan)
    listed[detections.run, rank] = value
    away = listed.take(run, axis=0)
    away -= mean[:, None]
    if angular:
        away = wrap_angle(away)
    # Nonzero entries of one axis are found several times faster than those of two.
    pair = (np.abs(away, out=away) <= reach[:, None]).ravel().nonzero()[0]
    track = pair // max(most, 1)
    return track, first[run[track]] + pair - track * most


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
        return GatedPairs(*map(methodcaller("take", which.nonzero()[0]), self))


def gated(
    predicted: PredictedMeasurement,
    measured: Measured,
    detections: RunDetections,
    run: Indices,
    threshold: float,
    compute: Compute,
) -> GatedPairs:
    """The pairs whose squared Mahalanobis distance is at most ``threshold``.

    Args:
        predicted: of each track, ``(m, L)``.
        measured: of each detection, ``(m, N)``.
        detections: of all runs.
        run: ``(L,)`` of each track.
        threshold: of chi-square with ``m`` degrees of freedom.
        compute: how equations are computed.
    """
    track, detection = _in_reach(predicted, measured, detections, run, threshold)
    distance, log_likelihood = _likelihood(predicted, measured, track, detection, compute)
    return GatedPairs(track, detection, distance, log_likelihood).select(distance <= threshold)


def under_modes(
    pairs: GatedPairs, predicted: PredictedMeasurement, measured: Measured, prior: Array, compute: Compute = by_numpy
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
    result = compute(
        _of_pair(measured.angular),
        {
            "value": measured.value.take(detection, axis=-1),
            "noise": noise,
            "expected": predicted.mean.take(track, axis=-1),
            "spread": predicted.covariance.take(track, axis=-1),
        },
    )
    return result["distance"], result["log_likelihood"]


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


def _in_reach(
    predicted: PredictedMeasurement, measured: Measured, detections: RunDetections, run: Indices, threshold: float
) -> tuple[Indices, Indices]:
    """Return the pairs that are close in one component, among which are all that are in the gate."""
    angular = len(measured.angular) == len(measured.value)
    axis = 0
    while axis in measured.angular and not angular:
        axis += 1
    noise = measured.noise[axis, axis]
    largest = noise if noise.ndim == 0 else noise.max(initial=0.0)
    reach = np.sqrt(threshold * (predicted.covariance[axis, axis] + largest))
    return close_pairs(predicted.mean[axis], reach, run, measured.value[axis], detections, angular)


def in_field_of_view(position: Array, scan: Scan) -> Mask:
    """``(L,)`` which positions ``(2, L)`` are in the field of view of the sensor."""
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    dx, dy = position[0] - scan.sensor_pose[0], position[1] - scan.sensor_pose[1]
    seen: Mask = dx * dx + dy * dy <= view.max_range * view.max_range
    if view.half_angle < np.pi:
        seen &= np.abs(wrap_angle(np.arctan2(dy, dx) - scan.sensor_pose[2])) <= view.half_angle
    return seen

"""Gates: detections that may stem from a track."""

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
    """N detections of a scan of many runs, sorted by run, without padding."""

    scan: Scan
    """Scan with ``measurement`` ``(m, N)`` and ``valid`` ``(N,)``, all True."""
    run: Indices
    """Run ``(N,)`` of each detection, as an index in the batch of runs."""
    column: Indices
    """Column ``(N,)`` of each detection in the scan of its run."""
    first: Indices
    """Index ``(runs + 1,)`` of the first detection of each run, then ``N``."""


def run_detections(scan: Scan, as_listed: bool) -> RunDetections:
    """Return the detections of a scan ``(m, D, runs)`` without padding.

    Within a run they stay in the scan's order if ``as_listed``, else they are sorted by value.
    """
    column_count, runs = scan.valid.shape
    flat = scan.measurement.reshape(len(scan.measurement), -1)
    first = np.zeros(runs + 1, dtype=np.intp)
    counts = scan.valid.sum(axis=0)
    counts.cumsum(out=first[1:])
    run = np.arange(runs).repeat(counts)
    place = (scan.valid.T.ravel().nonzero()[0] - run * column_count) * runs + run
    measurement = flat.take(place, axis=1)
    if not as_listed and len(run):
        order = _order(measurement, run)
        place, measurement = place[order], measurement.take(order, axis=1)
    unpadded = with_sensor_of(scan, run, measurement=measurement, valid=place >= 0)
    return RunDetections(unpadded, run, place // runs, first)


TINY = float(np.finfo(float).tiny)


def _order(measurement: Array, run: Indices) -> Indices:
    key = measurement[0]
    if run[-1]:
        # One key for both: the scaled first component is less than 1.
        lowest = key.min()
        spread = key.max() - lowest
        key = run + (key - lowest) / max(2.0 * spread, TINY)
    # The fast sort is unstable, so equal keys or NaN need a sort by all components.
    order: Indices = key.argsort()
    ranked = key[order]
    return order if (ranked[1:] > ranked[:-1]).all() else np.lexsort((*measurement[::-1], run))


def close_pairs(
    mean: Array, reach: Array, run: Indices, value: Array, detections: RunDetections, angular: bool
) -> tuple[Indices, Indices]:
    """Return pairs of a track and a detection of one run, at most the track's ``reach`` apart in one component.

    Args:
        mean: ``(L,)`` the component, as predicted for each track.
        reach: ``(L,)`` largest distance of a detection from each track.
        run: ``(L,)`` run of each track.
        value: ``(N,)`` the component of each detection.
        detections: detections of all runs.
        angular: whether the component is an angle.
    """
    first = detections.first
    rank = np.arange(len(value)) - first[detections.run]
    column_count = int(rank.max(initial=-1)) + 1
    listed = np.empty((len(first) - 1, column_count))
    listed.fill(np.nan)
    listed[detections.run, rank] = value
    distance = listed.take(run, axis=0)
    distance -= mean[:, None]
    if angular:
        distance = wrap_angle(distance)
    # Nonzero entries are found several times faster along one axis than along two.
    pair = (np.abs(distance, out=distance) <= reach[:, None]).ravel().nonzero()[0]
    track = pair // max(column_count, 1)
    return track, first[run[track]] + pair - track * column_count


class GatedPairs(NamedTuple):
    """Pairs of a track and a detection of its run in its gate, sorted by track, then by detection."""

    track: Indices
    """Index ``(P,)`` of each pair's track."""
    detection: Indices
    """Index ``(P,)`` of each pair's detection."""
    distance: Array
    """Squared Mahalanobis distance ``(P,)`` between detection and predicted measurement."""
    log_likelihood: Array
    """Log-likelihood ``(P,)`` of the detection if the track's object caused it."""

    def select(self, which: Mask) -> GatedPairs:
        """Return the pairs for which the mask is True."""
        return GatedPairs(*map(methodcaller("take", which.nonzero()[0]), self))


def gated(
    predicted: PredictedMeasurement,
    measured: Measured,
    detections: RunDetections,
    run: Indices,
    threshold: float,
    compute: Compute,
) -> GatedPairs:
    """Return the pairs of a track and a detection whose squared Mahalanobis distance is at most ``threshold``.

    Args:
        predicted: predicted measurement of each track, ``(m, L)``.
        measured: measured values of each detection, ``(m, N)``.
        detections: detections of all runs.
        run: ``(L,)`` run of each track.
        threshold: quantile of chi-square with ``m`` degrees of freedom.
        compute: engine of the equations.
    """
    track, detection = _in_reach(predicted, measured, detections, run, threshold)
    distance, log_likelihood = _likelihood(predicted, measured, track, detection, compute)
    return GatedPairs(track, detection, distance, log_likelihood).select(distance <= threshold)


def with_mode_likelihoods(
    pairs: GatedPairs, predicted: PredictedMeasurement, measured: Measured, prior: Array, compute: Compute = by_numpy
) -> GatedPairs:
    """Return the pairs with likelihoods under the mixture of modes, whose probabilities are ``prior`` ``(M, L)``."""
    of_mode = [_likelihood(mode, measured, pairs.track, pairs.detection, compute)[1] for mode in predicted.modes]
    joint = np.log(prior[:, pairs.track]) + np.stack(of_mode)
    largest = joint.max(axis=0)
    return pairs._replace(log_likelihood=largest + np.log(np.exp(joint - largest).sum(axis=0)))


def _likelihood(
    predicted: PredictedMeasurement, measured: Measured, track: Indices, detection: Indices, compute: Compute
) -> tuple[Array, Array]:
    noise = measured.noise if measured.noise.ndim == 2 else measured.noise.take(detection, axis=-1)
    result = compute(
        _distance_equations(measured.angular),
        {
            "value": measured.value.take(detection, axis=-1),
            "noise": noise,
            "expected": predicted.mean.take(track, axis=-1),
            "spread": predicted.covariance.take(track, axis=-1),
        },
    )
    return result["distance"], result["log_likelihood"]


@cache
def _distance_equations(angular: tuple[int, ...]) -> Equations:
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
    """Return pairs as track and detection indices that are close in one component, among them all gated pairs."""
    angular = len(measured.angular) == len(measured.value)
    axis = 0
    while axis in measured.angular and not angular:
        axis += 1
    noise = measured.noise[axis, axis]
    largest = noise if noise.ndim == 0 else noise.max(initial=0.0)
    reach = np.sqrt(threshold * (predicted.covariance[axis, axis] + largest))
    return close_pairs(predicted.mean[axis], reach, run, measured.value[axis], detections, angular)


def in_field_of_view(position: Array, scan: Scan) -> Mask:
    """Return a mask ``(L,)`` of the positions ``(2, L)`` in the fixed frame that are in the sensor's field of view."""
    view = scan.field_of_view or FieldOfView(np.pi, np.inf)
    dx, dy = position[0] - scan.sensor_pose[0], position[1] - scan.sensor_pose[1]
    is_seen: Mask = dx * dx + dy * dy <= view.max_range * view.max_range
    if view.half_angle < np.pi:
        is_seen &= np.abs(wrap_angle(np.arctan2(dy, dx) - scan.sensor_pose[2])) <= view.half_angle
    return is_seen

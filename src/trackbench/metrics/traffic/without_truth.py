"""Metrics of tracks in a recording without a truth: their number, predictions, and use of detections."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Scan, Tracks
from trackbench.base.units import difference
from trackbench.metrics.traffic.run import RunScores
from trackbench.metrics.traffic.set_distances import GospaParts
from trackbench.metrics.traffic.track_quality import RunSums
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.models.sensors.detection import detected_share
from trackbench.trackers.assume import distance_from_sensor
from trackbench.trackers.multi.gate import in_field_of_view

NONE = -1
#: Expected number of detections in a scan that no track predicts, for every tracker, uniform in the field of view.
UNPREDICTED = 1.0


class UnlabelledScan(NamedTuple):
    """Scan that a tracker has processed, with the tracks after it and a score of the tracks before it."""

    time: float
    """Time of the scan, s."""
    detections: int
    ids: Indices
    """``(K,)`` ids of the tracks after the scan."""
    used: Indices | None
    """``(K,)`` index of the detection that each track used, -1 for none; None where the tracker does not say."""
    nis: Array
    """``(n,)`` NIS divided by its degrees of freedom, of each used detection that a track had predicted."""
    log_score: float | None
    """Poisson score of the predicted intensity of detections; None where no predictions are known."""


def score_without_truth(scans: list[UnlabelledScan]) -> RunSums:
    """Return sum and number of terms of each metric of a recording without truth, by path; unknown ones are left out.

    A track that is cut by the begin or end of the log counts with the part of it within the log.
    """
    minutes = (scans[-1].time - scans[0].time) / 60
    tracks = {track for scan in scans for track in scan.ids.tolist()}
    sums = {
        "track_count": (float(sum(len(scan.ids) for scan in scans)), float(len(scans))),
        "new_tracks": (float(len(tracks)), minutes),
    }
    if all(scan.used is not None for scan in scans):
        used = sum(len(np.unique(scan.used[scan.used != NONE])) for scan in scans if scan.used is not None)
        sums["used_share"] = (float(used), float(sum(scan.detections for scan in scans)))
    predicted = [(scan.log_score, scan.detections) for scan in scans if scan.log_score is not None]
    if predicted:
        sums["prediction_score"] = (sum(score for score, _ in predicted), float(sum(count for _, count in predicted)))
        nis = np.concatenate([scan.nis for scan in scans])
        sums["nis"] = (float(nis.sum()), float(len(nis)))
    return {path: sums for path, sums in sums.items() if sums[1] > 0}


def run_scores_of(values: RunSums) -> RunScores:
    """Return the scores of a run without truth: metric values alone, without GOSPA, events and object states."""
    none = np.zeros(0)
    return RunScores(values, GospaParts(none, none, none), (), np.zeros((0, 0), dtype=np.int8))


def judged_scan(scan: Scan, config: Sensor, predicted: Tracks | None, tracks: Tracks) -> UnlabelledScan:
    """Return the scores of the tracks predicted for a scan of one run, with the tracks after the scan.

    Args:
        scan: scan with a ``measurement`` ``(m, D)``.
        config: options of the sensor.
        predicted: tracks predicted to the time of the scan; None where the tracker was not asked.
        tracks: tracks updated with the scan.
    """
    nis, score = np.zeros(0), None
    if predicted is not None:
        whitened, log_density = _densities(scan, predicted)
        squares = np.einsum("ikd,ikd->kd", whitened, whitened) / len(scan.measurement)
        nis = squares[_used_pairs(predicted, tracks)]
        score = _log_score(scan, config, predicted, log_density)
    return UnlabelledScan(scan.time, scan.measurement.shape[1], tracks.ids, tracks.used, nis, score)


def _densities(scan: Scan, predicted: Tracks) -> tuple[Array, Array]:
    """Return the whitened innovation ``(m, K, D)`` of each detection by each track, and its log density ``(K, D)``.

    The sensor's equation is linearised at the track, whatever filter the tracker has.
    """
    model = SENSOR_MODELS[scan.kind]
    pose, velocity = scan.sensor_pose[:, None], scan.sensor_velocity[:, None]
    expected = model.measure(predicted.mean, pose, velocity)
    slope = model.jacobian(predicted.mean, pose, velocity)
    covariance = np.einsum("iak,abk,jbk->ijk", slope, predicted.covariance, slope) + scan.noise_covariance[..., None]
    innovation = difference(scan.measurement[:, None, :], expected[:, :, None], model.angular)
    factor = linalg.cholesky(covariance[..., None])
    whitened = factor.whiten(innovation)
    norm = np.log(factor.inverse_diagonal).sum(axis=0) - 0.5 * len(innovation) * np.log(2 * np.pi)
    return whitened, norm - 0.5 * (whitened**2).sum(axis=0)


def _used_pairs(predicted: Tracks, tracks: Tracks) -> tuple[Indices, Indices]:
    used = np.full(len(tracks.ids), NONE) if tracks.used is None else tracks.used
    number, column = np.nonzero((tracks.ids[:, None] == predicted.ids) & (used >= 0)[:, None])
    return column, used[number]


def _log_score(scan: Scan, config: Sensor, predicted: Tracks, log_density: Array) -> float:
    """Return the Poisson score of the intensity of detections that the tracks predict; larger is better.

    Source: Brehmer, Gneiting, Herrmann, Marzocchi, Schlather and Strokorb (2024), "Comparative evaluation of point
    process forecasts". The score is consistent for the intensity, whether or not the process is Poisson.
    """
    probability = np.where(in_field_of_view(predicted.mean[:2], scan), scan.detection_probability or 0.0, 0.0)
    if predicted.existence is not None:
        probability = probability * predicted.existence
    if scan.half_range_m is not None:
        probability = probability * detected_share(distance_from_sensor(predicted.mean[:2], scan), scan.half_range_m)
    intensity = UNPREDICTED / config.volume() + np.einsum("k,kd->d", probability, np.exp(log_density))
    return float(np.log(intensity).sum() - probability.sum() - UNPREDICTED)

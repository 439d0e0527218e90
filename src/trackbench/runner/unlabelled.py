"""What a tracker predicted of the scans of a recording without a truth."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Scan, Tracks
from trackbench.base.units import difference
from trackbench.metrics.traffic.without_truth import UnlabelledScan
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.trackers.answers import NO_TRACK
from trackbench.trackers.multi.gate import in_view

#: Detections a scan that no track predicts, as they are expected of every tracker alike: uniform in the field of view.
UNPREDICTED = 1.0


def judged_scan(
    scan: Scan, own_track: Indices, config: Sensor, predicted: Tracks | None, tracks: Tracks
) -> UnlabelledScan:
    """What the tracks before and after a scan say of it; of one run each.

    Args:
        scan: ``measurement`` ``(m, D)``.
        own_track: ``(D,)`` the sensor's own track that each detection is of.
        config: of the sensor.
        predicted: the tracks at its time without its detections; None where the tracker was not asked.
        tracks: those with them.
    """
    nis, score = np.zeros(0), None
    if predicted is not None:
        whitened, log_density = _densities(scan, predicted)
        squares = np.einsum("ikd,ikd->kd", whitened, whitened) / len(scan.measurement)
        nis = squares[_pairs(predicted, tracks)]
        score = _log_score(scan, config, predicted, log_density)
    return UnlabelledScan(scan.sensor, scan.time, own_track, tracks.ids, tracks.used, nis, score)


def _densities(scan: Scan, predicted: Tracks) -> tuple[Array, Array]:
    """``(m, K, D)`` the whitened innovation of each detection by each track, and ``(K, D)`` its log density.

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


def _pairs(predicted: Tracks, tracks: Tracks) -> tuple[Indices, Indices]:
    """Tracks that were predicted, by their column there, and the detection that each used."""
    if tracks.used is None:
        none = np.zeros(0, dtype=np.intp)
        return none, none
    column = {id: k for k, id in enumerate(predicted.ids.tolist()) if id != NO_TRACK}
    pairs = [
        (column[id], used)
        for id, used in zip(tracks.ids.tolist(), tracks.used.tolist(), strict=True)
        if used >= 0 and id in column
    ]
    columns = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return columns[:, 0], columns[:, 1]


def _log_score(scan: Scan, config: Sensor, predicted: Tracks, log_density: Array) -> float:
    """Poisson score of the intensity of detections that the tracks predict; the larger, the better.

    Source: Brehmer, Gneiting, Herrmann, Marzocchi, Schlather and Strokorb (2024), "Comparative evaluation of point
    process forecasts": it is consistent for the intensity, whether or not the process is Poisson.
    """
    probability = np.where(in_view(predicted.mean[:2], scan), scan.detection_probability or 0.0, 0.0)
    if predicted.existence is not None:
        probability = probability * predicted.existence
    intensity = UNPREDICTED / config.volume() + np.einsum("k,kd->d", probability, np.exp(log_density))
    return float(np.log(intensity).sum() - probability.sum() - UNPREDICTED)

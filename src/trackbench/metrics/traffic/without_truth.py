"""What tracks tell where there is no truth: how they predict and use detections, and agree with the sensor's tracks."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
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
from trackbench.trackers.answers import NO_TRACK
from trackbench.trackers.assume import distance_from_sensor
from trackbench.trackers.multi.gate import in_field_of_view

NONE = -1
#: Detections a scan that no track predicts, as they are expected of every tracker alike: uniform in the field of view.
UNPREDICTED = 1.0


class UnlabelledScan(NamedTuple):
    """A scan that a tracker has taken in, and what the tracker said before and after it."""

    sensor: str
    time: float
    """s"""
    own_track: Indices
    """``(D,)`` the sensor's own track that each detection is of; negative where it does not say."""
    ids: Indices
    """``(K,)`` of the tracks after it."""
    used: Indices | None
    """``(K,)`` the detection that each used, -1 for none; None where the tracker does not say."""
    nis: Array
    """``(n,)`` normalised innovation squared over its degrees of freedom, of the used detections that were
    predicted."""
    log_score: float | None
    """Poisson score of the predicted intensity of detections; None where the tracker was not asked."""


def score_without_truth(scans: list[UnlabelledScan]) -> RunSums:
    """Path to (total, count) of each metric of ``DETECTION_METRICS`` that can be told.

    Tracks that the log begins or ends with count as long as they are seen.
    """
    minutes = (scans[-1].time - scans[0].time) / 60
    lengths = _lengths((scan.time, scan.ids.tolist()) for scan in scans)
    sums = {
        "track_count": (float(sum(len(scan.ids) for scan in scans)), float(len(scans))),
        "track_length": (float(np.median(lengths)) if len(lengths) else 0.0, float(len(lengths) > 0)),
        "new_tracks": (float(len(lengths)), minutes),
    }
    if all(scan.used is not None for scan in scans):
        sums |= _use(scans, float(lengths.sum()) / 60)
    predicted = [(scan.log_score, len(scan.own_track)) for scan in scans if scan.log_score is not None]
    if predicted:
        sums["prediction_score"] = (sum(score for score, _ in predicted), float(sum(count for _, count in predicted)))
        nis = np.concatenate([scan.nis for scan in scans])
        sums["nis"] = (float(nis.sum()), float(len(nis)))
    return {path: sums for path, sums in sums.items() if sums[1] > 0}


def scores_without_truth(values: RunSums) -> RunScores:
    """The scores of a run of which nothing else is known."""
    none = np.zeros(0)
    parts = GospaParts(none, none, none)
    return RunScores(values, parts, none, None, (), np.zeros((0, 0), dtype=np.int8))


def _use(scans: list[UnlabelledScan], track_minutes: float) -> RunSums:
    used = sum(len(np.unique(_used(scan)[_used(scan) != NONE])) for scan in scans)
    sums = {"used_share": (float(used), float(sum(len(scan.own_track) for scan in scans)))}
    own = _lengths((scan.time, [(scan.sensor, number) for number in _present(scan)]) for scan in scans)
    if len(own):
        breaks, own_breaks, swaps = _changes(scans)
        sums["track_breaks"] = (float(breaks), float(own.sum()) / 60)
        sums["own_track_breaks"] = (float(own_breaks), track_minutes)
        sums["track_swaps"] = (float(swaps), track_minutes)
    return sums


def _changes(scans: list[UnlabelledScan]) -> tuple[int, int, int]:
    """How often tracks and the sensor's own tracks pair anew, by which of the earlier pair is there no more: the track,
    the sensor's own track, or neither."""
    track_of: dict[tuple[str, int], int] = {}
    own_of: dict[tuple[str, int], int] = {}
    breaks = own_breaks = swaps = 0
    for scan in scans:
        ids, present = set(scan.ids.tolist()), set(_present(scan))
        column = np.flatnonzero(_used(scan) != NONE)
        pairs = np.stack([scan.ids[column], scan.own_track[_used(scan)[column]]], axis=1)
        for track, own in sorted(pairs[pairs[:, 1] >= 0].tolist()):
            earlier, earlier_own = track_of.get((scan.sensor, own)), own_of.get((scan.sensor, track))
            breaks += earlier is not None and earlier not in ids
            if earlier_own is not None and earlier_own != own:
                own_breaks += earlier_own not in present
                swaps += earlier_own in present
            track_of[scan.sensor, own], own_of[scan.sensor, track] = track, own
    return breaks, own_breaks, swaps


def _used(scan: UnlabelledScan) -> Indices:
    assert scan.used is not None
    return scan.used


def _present(scan: UnlabelledScan) -> list[int]:
    """The sensor's own tracks in a scan."""
    return [int(number) for number in scan.own_track if number >= 0]


def _lengths(scans: Iterable[tuple[float, Iterable[Hashable]]]) -> Array:
    """How long each of what is there is seen, s."""
    spans: dict[Hashable, tuple[float, float]] = {}
    for time, there in scans:
        for item in there:
            spans[item] = (spans.get(item, (time, time))[0], time)
    return np.array([last - first for first, last in spans.values()])


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
    probability = np.where(in_field_of_view(predicted.mean[:2], scan), scan.detection_probability or 0.0, 0.0)
    if predicted.existence is not None:
        probability = probability * predicted.existence
    if scan.half_range_m is not None:
        probability = probability * detected_share(distance_from_sensor(predicted.mean[:2], scan), scan.half_range_m)
    intensity = UNPREDICTED / config.volume() + np.einsum("k,kd->d", probability, np.exp(log_density))
    return float(np.log(intensity).sum() - probability.sum() - UNPREDICTED)

"""What tracks tell where there is no truth: how they agree with the detections, and with the sensor's own tracks."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.run import RunScores
from trackbench.metrics.traffic.set_distances import GospaParts
from trackbench.metrics.traffic.track_quality import RunSums

NONE = -1


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
    return RunScores(values, parts, none, None, (), np.zeros((0, 0), dtype=np.int8), True)


def _use(scans: list[UnlabelledScan], track_minutes: float) -> RunSums:
    used = sum(len(np.unique(_used(scan)[_used(scan) != NONE])) for scan in scans)
    sums = {"used_share": (float(used), float(sum(len(scan.own_track) for scan in scans)))}
    own = _lengths((scan.time, [(scan.sensor, number) for number in _present(scan)]) for scan in scans)
    if len(own):
        changes = _changes(scans)
        sums["track_breaks"] = (float(changes.track_breaks), float(own.sum()) / 60)
        sums["own_track_breaks"] = (float(changes.own_track_breaks), track_minutes)
        sums["track_swaps"] = (float(changes.swaps), track_minutes)
    return sums


class _Changes(NamedTuple):
    track_breaks: int
    own_track_breaks: int
    swaps: int


def _changes(scans: list[UnlabelledScan]) -> _Changes:
    """How often tracks and the sensor's own tracks pair anew, by which of the earlier pair is there no more."""
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
    return _Changes(breaks, own_breaks, swaps)


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

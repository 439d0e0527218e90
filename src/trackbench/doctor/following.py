"""A tracker taken through the scans of a drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.doctor.session import Broken, Session
from trackbench.doctor.vitals import Vitals
from trackbench.trackers.answers import shaped, unpack
from trackbench.trackers.base import Tracker
from trackbench.types import Array, Mask, Scan


class Track(NamedTuple):
    """What a tracker said after each scan, NaN where nothing."""

    mean: Array
    """``(4, scans, runs)``"""
    covariance: Array
    """``(4, 4, scans, runs)``"""
    said: Mask
    """``(scans, runs)``: whether there was an answer at all."""


def follow(make: Callable[[], Tracker], scans: Sequence[Scan], vitals: Vitals | None = None, where: str = "") -> Track:
    """Take a fresh tracker (or one for each run) through scans with the batch axis ``(runs,)``.

    Raises:
        Broken: it raised, or gave something that is no estimate.
    """
    batched = bool(getattr(make(), "batched", False))
    track = _together(make, scans) if batched else _one_by_one(make, scans)
    if vitals is not None:
        for k, scan in enumerate(scans):
            said = track.said[k]
            vitals.note_all(track.mean[:, k, said], track.covariance[:, :, k, said], scan, where)
    return track


def _together(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Track:
    tracker, state, track = make(), None, _nothing(scans)
    for k, scan in enumerate(scans):
        try:
            state, said = unpack(tracker.step(state, scan))
            estimate = shaped(said, scan)
        except (Exception, SystemExit) as error:
            raise Broken(error, scan) from error
        if estimate is not None:
            track.mean[:, k], track.covariance[:, :, k] = estimate.mean, estimate.covariance
            # A batched tracker has NaN for a target of which it knows nothing yet.
            track.said[k] = ~np.isnan(estimate.mean).all(axis=0) | (k > 0 and track.said[k - 1])
    return track


def _one_by_one(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Track:
    track = _nothing(scans)
    for run in range(scans[0].valid.size):
        session: Session | None = None
        for k, scan in enumerate(scans):
            if session is None and not scan.valid[run]:
                continue
            session = session or Session(make)
            answer = session.step(one_run(scan, run))
            if answer is not None:
                track.mean[:, k, run], track.covariance[:, :, k, run] = answer.mean, answer.covariance
                track.said[k, run] = True
    return track


def one_run(scan: Scan, run: int) -> Scan:
    """The scan of one run, without a batch axis."""
    return scan._replace(measurement=scan.measurement[:, run], valid=scan.valid[run])


def _nothing(scans: Sequence[Scan]) -> Track:
    shape: Any = (len(scans), scans[0].valid.size)
    return Track(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan), np.zeros(shape, dtype=bool))

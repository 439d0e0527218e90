"""What a tracker of several objects asks of a filter."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask, Scan
from trackbench.filters import (
    AnyBelief,
    Filter,
    Measured,
    PredictedMeasurement,
    bare,
    placed,
    select,
    selected_prediction,
)
from trackbench.models.motion import MotionModel
from trackbench.trackers.initial import InitialConfig, first_measurement
from trackbench.trackers.multi.gate import close_in_one, in_view
from trackbench.trackers.multi.mixture import of_pairs


class PredictedTracks(NamedTuple):
    """Tracks at the time of a scan, and what they expect of it."""

    belief: AnyBelief
    """With what the filter can reuse for its update."""
    measurement: PredictedMeasurement
    in_view: Mask
    """``(...)`` which are in the field of view of the sensor."""


class TrackFilter:
    """A filter on the beliefs of the L tracks that take in the N detections of a scan."""

    close = staticmethod(close_in_one)

    def __init__(self, filter: Filter[Any], initial: InitialConfig) -> None:
        self.filter = filter
        self.initial = initial

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion models that the filter runs."""
        return self.filter.motions

    def measured(self, scan: Scan) -> Measured:
        """The detections in the space in which the filter compares them with its predictions."""
        return self.filter.measured(scan)

    def begin(self, scan: Scan) -> AnyBelief:
        """Of N tracks: what each detection says by itself."""
        return begun(self.filter, self.initial, scan)

    def expect(self, belief: AnyBelief, dt: float, scan: Scan) -> PredictedTracks:
        """What is expected of a scan ``dt`` seconds later, at whose detections it does not look."""
        return expected(self.filter, self.filter.predict(belief, dt), scan)

    def after(self, at: PredictedTracks, scan: Scan, track: Indices, detection: Indices) -> AnyBelief:
        """Of P members: the belief of a track after the detection that stands beside it.

        Args:
            at: of the L tracks.
            scan: of N detections, all valid.
            track, detection: ``(P,)``
        """
        own, predicted = detections_of(scan, detection), selected_prediction(at.measurement, track)
        found: AnyBelief = self.filter.update(select(at.belief, track), own, predicted).belief
        return found

    def taken_in(self, at: PredictedTracks, scan: Scan, detection: Indices) -> AnyBelief:
        """Of the L tracks: the belief after the detection ``(L,)`` of each; as it was where that is negative."""
        belief, track = bare(at.belief), np.flatnonzero(detection >= 0)
        return placed(belief, track, self.after(at, scan, track, detection[track])) if len(track) else belief

    def mixture(
        self, at: PredictedTracks, scan: Scan, track: Indices, detection: Indices, share: Array, kept: Array
    ) -> AnyBelief:
        """Of the L tracks: the mixture of their prediction and of their update with each of their detections.

        Args:
            at: of the L tracks.
            scan: of N detections, all valid.
            track, detection: ``(P,)``, sorted by track.
            share: ``(P,)`` the probability of each detection.
            kept: ``(L,)`` the probability of none.
        """
        before = bare(at.belief)
        if not len(track):
            return before
        return of_pairs(self.motions, before, self.after(at, scan, track, detection), track, share, kept)


def begun(filter: Filter[Any], initial: InitialConfig, scan: Scan) -> AnyBelief:
    """What each detection of a scan says by itself."""
    found: AnyBelief = filter.begin(lambda motion: first_measurement(motion, initial, scan))
    return found


def expected(filter: Filter[Any], belief: AnyBelief, scan: Scan) -> PredictedTracks:
    """What a belief at the time of a scan expects of it."""
    seen = in_view(filter.cartesian(belief).mean[:2], scan)
    return PredictedTracks(belief, filter.predict_measurement(belief, scan), seen)


def detections_of(scan: Scan, which: Indices) -> Scan:
    """Some detections of a scan, or the same one several times."""
    return scan._replace(measurement=scan.measurement.take(which, axis=1), valid=scan.valid[which])

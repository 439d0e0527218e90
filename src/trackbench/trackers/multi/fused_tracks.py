"""Filter steps of a multi-object tracker as compiled kernels."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from trackbench.base.types import Array, FieldOfView, Indices, Scan
from trackbench.engine.beliefs import (
    any_scan,
    belief_of,
    belief_values,
    prediction_of,
    prediction_values,
    scan_of,
    scan_values,
    sensor_values,
)
from trackbench.engine.equations import Values
from trackbench.engine.filters import FilterCall, FusedFilter, predicted_belief
from trackbench.filters import AnyBelief, choose, compact
from trackbench.trackers.initial import InitialConfig
from trackbench.trackers.multi.mixture import mix_slots
from trackbench.trackers.multi.table import (
    NONE,
    PredictedTracks,
    TrackFilter,
    first_beliefs,
    predicted_tracks,
    rank_in_run,
    selected_detections,
)

#: Largest number of detections of a track that a kernel handles.
MOST_SLOTS = 6


class FusedTrackFilter(TrackFilter):
    """Track filter that computes each of its methods by one kernel of the fused engine."""

    filter: FusedFilter

    def __init__(self, filter: Any, initial: InitialConfig) -> None:
        super().__init__(filter, initial)
        self._first_beliefs = partial(_first_beliefs, initial=initial)
        self._initial_key = initial.model_dump_json()

    def begin(self, scan: Scan) -> AnyBelief:
        result = self.filter.computed("start", self._first_beliefs, scan_values(scan), scan, self._initial_key)
        return belief_of(result, self.filter.modes)

    def expect(self, belief: AnyBelief, dt: float, scan: Scan) -> PredictedTracks:
        values = belief_values(belief) | self.filter.time(dt) | sensor_values(scan)
        result = self.filter.computed(
            "expectation of a later scan", partial(_expect, view=scan.field_of_view), values, scan, scan.field_of_view
        )
        modes = self.filter.modes
        return PredictedTracks(
            belief_of(result, modes), prediction_of(result, modes), np.asarray(result["in view"], dtype=bool)
        )

    def updated_tracks(self, tracks: PredictedTracks, scan: Scan, detection: Indices) -> AnyBelief:
        valid = detection >= 0
        if not valid.any():
            return tracks.belief
        # A kernel over all tracks is faster than gathering some of them. A track without a detection is paired with
        # the last one, which the kernel ignores.
        return self._updated(tracks, selected_detections(scan, detection, valid))

    def mixture(
        self, tracks: PredictedTracks, scan: Scan, track: Indices, detection: Indices, share: Array, missed: Array
    ) -> AnyBelief:
        if not len(track):
            return tracks.belief
        # Slots let the kernel compute once what all detections of a track share.
        slot = rank_in_run(track, len(missed))
        # At least two, since a sum of one product is rounded at another place.
        slots = max(int(slot.max()) + 1, 2)
        if slots > MOST_SLOTS:
            # Only tracks with many detections, so that the bits of a track do not depend on other tracks.
            has_many = np.bincount(track, minlength=len(missed)) > MOST_SLOTS
            is_few, is_many = ~has_many[track], has_many[track]
            rest = self.mixture(tracks, scan, track[is_few], detection[is_few], share[is_few], missed)
            mixed = super().mixture(tracks, scan, track[is_many], detection[is_many], share[is_many], missed)
            return choose(has_many, mixed, compact(rest))
        of_slot, weight = np.full((slots, len(missed)), NONE), np.zeros((slots, len(missed)))
        of_slot[slot, track], weight[slot, track] = detection, share
        in_slot = [selected_detections(scan, which) for which in of_slot]
        values = belief_values(tracks.belief) | prediction_values(tracks.measurement) | sensor_values(in_slot[0])
        values |= {"valid": of_slot[0] != NONE, "kept": missed}
        for number, slot_scan in enumerate(in_slot):
            values[f"measurement {number}"] = slot_scan.measurement
            if slot_scan.noise_covariance.ndim > 2:
                values[f"noise {number}"] = slot_scan.noise_covariance
            values[f"share {number}"] = weight[number]
        result = self.filter.computed("mixture", partial(_mixture, slots=slots), values, scan, slots)
        return belief_of(result, self.filter.modes)

    def _updated(self, tracks: PredictedTracks, scan: Scan) -> AnyBelief:
        values = belief_values(tracks.belief) | prediction_values(tracks.measurement) | scan_values(scan)
        return belief_of(self.filter.computed("belief", _after, values, scan), self.filter.modes)


def _first_beliefs(call: FilterCall, values: Values, initial: InitialConfig) -> Values:
    return belief_values(first_beliefs(call.filter, initial, scan_of(values, call.scan)))


def _expect(call: FilterCall, values: Values, view: FieldOfView | None) -> Values:
    scan = any_scan(values, call.scan)._replace(field_of_view=view)
    result = predicted_tracks(call.filter, predicted_belief(call, values), scan)
    return {**belief_values(compact(result.belief)), **prediction_values(result.measurement), "in view": result.in_view}


def _after(call: FilterCall, values: Values) -> Values:
    before, scan = belief_of(values, call.modes), scan_of(values, call.scan)
    after = call.filter.update(before, scan, prediction_of(values, call.modes)).belief
    return belief_values(choose(scan.valid, compact(after), compact(before)))


def _mixture(call: FilterCall, values: Values, slots: int) -> Values:
    before, predicted = belief_of(values, call.modes), prediction_of(values, call.modes)
    scans = []
    for number in range(slots):
        slot_values = {name: values.get(f"{name} {number}", values.get(name)) for name in ("measurement", "noise")}
        scans.append(scan_of({**values, **slot_values}, call.scan))
    updated = [compact(call.filter.update(before, scan, predicted).belief) for scan in scans]
    share = [values[f"share {number}"] for number in range(slots)]
    mixed = mix_slots(call.filter.motions, compact(before), updated, share, values["kept"])
    return belief_values(choose(values["valid"], mixed, compact(before)))

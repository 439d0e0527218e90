"""The filter steps of a tracker of several objects, as kernels."""

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
from trackbench.trackers.multi.mixture import of_slots
from trackbench.trackers.multi.table import (
    NONE,
    PredictedTracks,
    TrackFilter,
    begun,
    expected,
    rank_in_run,
    selected_detections,
)

#: Most detections of a track for which there are kernels.
MOST_SLOTS = 6


class FusedTrackFilter(TrackFilter):
    """Each of its methods one kernel."""

    filter: FusedFilter

    def __init__(self, filter: Any, initial: InitialConfig) -> None:
        super().__init__(filter, initial)
        self._begun = partial(_begun, initial=initial)
        self._initial_key = initial.model_dump_json()

    def begin(self, scan: Scan) -> AnyBelief:
        result = self.filter.computed("start", self._begun, scan_values(scan), scan, self._initial_key)
        return belief_of(result, self.filter.modes)

    def expect(self, belief: AnyBelief, dt: float, scan: Scan) -> PredictedTracks:
        values = belief_values(belief) | self.filter.time(dt) | sensor_values(scan)
        result = self.filter.computed(
            "expectation of a later scan", partial(_expected, view=scan.field_of_view), values, scan, scan.field_of_view
        )
        modes = self.filter.modes
        return PredictedTracks(
            belief_of(result, modes), prediction_of(result, modes), np.asarray(result["in view"], dtype=bool)
        )

    def taken_in(self, at: PredictedTracks, scan: Scan, detection: Indices) -> AnyBelief:
        valid = detection >= 0
        if not valid.any():
            return at.belief
        # The kernel is quicker with all tracks, as they lie, than with some that have to be gathered. What has no
        # detection is given one, the last, that is not looked at.
        return self._updated(at, selected_detections(scan, detection, valid))

    def mixture(
        self, at: PredictedTracks, scan: Scan, track: Indices, detection: Indices, share: Array, kept: Array
    ) -> AnyBelief:
        if not len(track):
            return at.belief
        # What is the same with every detection of a track is then computed once.
        slot = rank_in_run(track, len(kept))
        # Of two at least: a sum of one product would be rounded elsewhere than one of several.
        slots = max(int(slot.max()) + 1, 2)
        if slots > MOST_SLOTS:
            # Of those tracks alone, so that the bits of a track do not depend on the others.
            large = np.bincount(track, minlength=len(kept)) > MOST_SLOTS
            few, many = ~large[track], large[track]
            rest = self.mixture(at, scan, track[few], detection[few], share[few], kept)
            mixed = super().mixture(at, scan, track[many], detection[many], share[many], kept)
            return choose(large, mixed, compact(rest))
        of_slot, weight = np.full((slots, len(kept)), NONE), np.zeros((slots, len(kept)))
        of_slot[slot, track], weight[slot, track] = detection, share
        in_slot = [selected_detections(scan, which) for which in of_slot]
        values = belief_values(at.belief) | prediction_values(at.measurement) | sensor_values(in_slot[0])
        values |= {"valid": of_slot[0] != NONE, "kept": kept}
        for number, own in enumerate(in_slot):
            values[f"measurement {number}"] = own.measurement
            if own.noise_covariance.ndim > 2:
                values[f"noise {number}"] = own.noise_covariance
            values[f"share {number}"] = weight[number]
        result = self.filter.computed("mixture", partial(_mixture, slots=slots), values, scan, slots)
        return belief_of(result, self.filter.modes)

    def _updated(self, at: PredictedTracks, scan: Scan) -> AnyBelief:
        """The belief of each member after its detection; where it is not valid, as it is."""
        values = belief_values(at.belief) | prediction_values(at.measurement) | scan_values(scan)
        return belief_of(self.filter.computed("belief", _after, values, scan), self.filter.modes)


def _begun(call: FilterCall, values: Values, initial: InitialConfig) -> Values:
    return belief_values(begun(call.filter, initial, scan_of(values, call.scan)))


def _expected(call: FilterCall, values: Values, view: FieldOfView | None) -> Values:
    scan = any_scan(values, call.scan)._replace(field_of_view=view)
    result = expected(call.filter, predicted_belief(call, values), scan)
    return {**belief_values(compact(result.belief)), **prediction_values(result.measurement), "in view": result.in_view}


def _after(call: FilterCall, values: Values) -> Values:
    before, scan = belief_of(values, call.modes), scan_of(values, call.scan)
    after = call.filter.update(before, scan, prediction_of(values, call.modes)).belief
    return belief_values(choose(scan.valid, compact(after), compact(before)))


def _mixture(call: FilterCall, values: Values, slots: int) -> Values:
    before, predicted = belief_of(values, call.modes), prediction_of(values, call.modes)
    scans = []
    for number in range(slots):
        own = {name: values.get(f"{name} {number}", values.get(name)) for name in ("measurement", "noise")}
        scans.append(scan_of({**values, **own}, call.scan))
    updated = [compact(call.filter.update(before, scan, predicted).belief) for scan in scans]
    share = [values[f"share {number}"] for number in range(slots)]
    mixed = of_slots(call.filter.motions, compact(before), updated, share, values["kept"])
    return belief_values(choose(values["valid"], mixed, compact(before)))

"""A tracker of several objects: a filter, an association and a rule for tracks to begin and end."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.base.types import Indices, Scan, Tracks, with_sensor_of
from trackbench.engine.choice import compute_by
from trackbench.filters import AnyBelief, compact
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.associate import COUNTING, EXISTENCE, AssociateConfig
from trackbench.trackers.builtin import filter_of
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import BuiltInTracker
from trackbench.trackers.late import LateScans
from trackbench.trackers.multi.association import AssociationInput, associated
from trackbench.trackers.multi.gate import run_detections
from trackbench.trackers.multi.intensity import Detectability, Undetected, intensity
from trackbench.trackers.multi.management import TrackManager
from trackbench.trackers.multi.table import (
    NONE,
    TrackFilter,
    TrackTable,
    numbered,
    reported_tracks,
    succeeded,
)


class MultiObjectState(NamedTuple):
    """What the tracker knows after a scan."""

    time: float
    """Of the latest scan at which the state advanced, s."""
    table: TrackTable
    next_id: Indices
    """``(runs,)``"""
    undetected: Undetected
    expected: AnyBelief | None = None
    """Of the tracks before the latest scan, at its time."""
    before: TrackTable | None = None
    """Those tracks, their beliefs at the time of the scan before."""


@dataclass(frozen=True)
class MultiObjectTracker(BuiltInTracker):
    """Follows several objects by detections that nobody labelled, in one run or in many runs at once.

    The tracks of all runs lie side by side, ``(n, L)``, each with the number of its run: none waits unused, and a run
    may have as many as it needs.
    """

    associate: AssociateConfig = field(kw_only=True)

    multi_object: ClassVar = True

    @property
    def wants_origins(self) -> bool:
        """Whether ``step`` is to be told which object caused each detection."""
        return self.associate.method == "oracle"

    @cached_property
    def _track_filter(self) -> TrackFilter:
        if self.engine == "numpy":
            return TrackFilter(self.computed_filter, self.initial)
        # Its import takes a moment.
        from trackbench.trackers.multi.fused_tracks import FusedTrackFilter

        return FusedTrackFilter(self.computed_filter, self.initial)

    @cached_property
    def _manager(self) -> TrackManager:
        return TrackManager(self.associate, self._track_filter, compute_by(self.engine))

    @cached_property
    def _detectability(self) -> Detectability:
        return Detectability(self.associate.detection_probability, self.assumed)

    def step(
        self, state: MultiObjectState | None, scan: Scan, origins: Indices | None = None
    ) -> tuple[MultiObjectState | None, Tracks]:
        """Predict to the scan's time, associate its detections, and let tracks begin and end.

        Args:
            state: None at first.
            scan: of one run (``measurement`` ``(m, D)``) or of many (``(m, D, runs)``).
            origins: ``(2, D)`` or ``(2, D, runs)`` number of the object that caused each detection, and of a second one
                that is merged with it, negative for none; only for the oracle.

        A scan that is older than the state is dropped; the tracks are then those at the state's time.
        """
        if scan.valid.ndim == 1:
            single = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
            state, tracks = self.step(state, single, None if origins is None else origins[..., None])
            return state, _alone(tracks)
        scan, runs = self.assumed.stated(scan), scan.valid.shape[1]
        if state is None:
            table, undetected = self._manager.empty_table(), Undetected(self.associate.undetected, {})
            if scan.asked:
                # Its first scan may still be on its way.
                return None, self._tracks(table, runs)
            state = MultiObjectState(scan.time, table, np.zeros(runs, dtype=np.intp), undetected)
        if scan.asked or (self.sensors is not None and not self.reads(scan.sensor)):
            ahead, answer = self._prediction(state, max(scan.time, state.time))
            return (ahead if self.advance_at == "all_scans" and not scan.asked else state), answer
        if scan.time < state.time:
            return state, self._prediction(state, state.time)[1]
        return self._in_sequence(state, scan, origins)

    def _in_sequence(
        self, state: MultiObjectState, scan: Scan, origins: Indices | None = None
    ) -> tuple[MultiObjectState, Tracks]:
        at_tracks = with_sensor_of(scan, state.table.run)
        expected = self._track_filter.expect(state.table.belief, scan.time - state.time, at_tracks)
        ahead = self._at(state, scan.time)
        config, runs = self.associate, len(ahead.next_id)
        detections = run_detections(scan, as_listed=config.method == "naive")
        if self.assumed.effects:
            detections = detections._replace(scan=self.assumed.with_noise_by_range(detections.scan))
        of_tracks, of_detections = self._detectability.probabilities(
            self._track_filter.filter, expected.belief, at_tracks, detections.scan
        )
        origin = None if origins is None else origins[:, detections.column, detections.run]
        in_view, measured = ahead.undetected.in_view(scan.sensor), self._track_filter.measured(detections.scan)
        density = intensity(
            detections.scan,
            measured.value is detections.scan.measurement,
            config,
            in_view[detections.run] if isinstance(in_view, np.ndarray) else in_view,
            of_detections,
            self.initial.velocity_sigma_mps,
        )
        probability = np.where(expected.in_view, of_tracks, 0.0)
        at = AssociationInput(
            self._track_filter, expected, detections, measured, ahead.table.run, probability, config.gate, density
        )
        result = associated(config, at, ahead.table, origin, of_tracks, self._manager.compute)
        table, ends = self._manager.judged(ahead.table, result, at)
        begins = self.initial.sensors is None or scan.sensor in self.initial.sensors
        begins &= SENSOR_MODELS[scan.kind].measures_position()
        table = succeeded(table, ~ends, self._manager.begun(at, result.unclaimed, origin) if begins else None)
        table, next_id = numbered(table, self._manager.logic.confirms(table.evidence), ahead.next_id)
        undetected = ahead.undetected
        if config.method in EXISTENCE:
            detects = self._detectability.stated(scan), self._detectability.half_range_m(scan)
            undetected = undetected.after_scan(scan, *detects)
        after = MultiObjectState(scan.time, table, next_id, undetected, expected.belief, ahead.table)
        return after, self._tracks(table, runs)

    def _prediction(self, state: MultiObjectState, time: float) -> tuple[MultiObjectState, Tracks]:
        ahead, belief = self._at(state, time), state.table.belief
        if len(state.table.run):
            belief = compact(self._track_filter.filter.predict(belief, time - state.time))
        ahead = ahead._replace(table=ahead.table._replace(belief=belief))
        table = ahead.table._replace(used=np.full_like(ahead.table.used, NONE))
        return ahead, self._tracks(table, len(ahead.next_id))

    def predicted(self, state: MultiObjectState, run: int) -> Tracks:
        """The tracks of one run, ``(K,)``, as they were expected at the latest scan, before its detections."""
        assert state.before is not None
        assert state.expected is not None
        table = state.before._replace(belief=compact(state.expected)).select(state.before.run == run)
        return _alone(
            self._tracks(table._replace(run=np.zeros_like(table.run), used=np.full_like(table.used, NONE)), 1)
        )

    def _at(self, state: MultiObjectState, time: float) -> MultiObjectState:
        """The state at a later time, but for the beliefs."""
        elapsed, table, config = time - state.time, state.table, self.associate
        undetected = state.undetected
        if config.method in EXISTENCE:
            survival = float(np.exp(-elapsed / config.lifetime_s))
            undetected = undetected.after_time(survival, config.birth_rate_hz * elapsed)
            table = table._replace(evidence=self._manager.logic.after_time(table.evidence, elapsed))
        return MultiObjectState(time, table, state.next_id, undetected)

    def _tracks(self, table: TrackTable, runs: int) -> Tracks:
        if self.associate.method in COUNTING:
            return reported_tracks(table, self._track_filter.filter, None, runs)
        least = self.associate.report_limits[1]
        return reported_tracks(table, self._track_filter.filter, table.evidence[0], runs, least)


def _alone(tracks: Tracks) -> Tracks:
    return Tracks._make(None if part is None else part[..., 0] for part in tracks)


def build_multi(config: FilterConfig) -> LateScans:
    """The tracker that a scenario's ``filter:`` entry with ``associate:`` describes."""
    assert config.associate is not None
    tracker = MultiObjectTracker(filter_of(config), config.initial, associate=config.associate, **config.scan_options)
    return LateScans(tracker, config.late, config.lag_s)

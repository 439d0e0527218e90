"""Multi-object tracker: a filter, an association, and rules for tracks to begin and end."""

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
    reported_tracks,
    with_ids,
    with_new_tracks,
)


class MultiObjectState(NamedTuple):
    """Tracks of a multi-object tracker after a scan, with all that the next scan needs."""

    time: float
    """Time of the latest scan that moved the state in time, s."""
    table: TrackTable
    next_id: Indices
    """Next free track id of each run, ``(runs,)``."""
    undetected: Undetected
    expected: AnyBelief | None = None
    """Beliefs of the tracks predicted to the latest scan, before its detections were used."""
    before: TrackTable | None = None
    """Tracks before the latest scan, with their beliefs at the time of the scan before it."""


@dataclass(frozen=True)
class MultiObjectTracker(BuiltInTracker):
    """Tracker of several objects from detections without identities, in one run or in many runs at once.

    The tracks of all runs are stored side by side, ``(n, L)``, each with the number of its run. So runs may have any
    number of tracks without padding.
    """

    associate: AssociateConfig = field(kw_only=True)

    multi_object: ClassVar = True

    @property
    def wants_origins(self) -> bool:
        """Whether ``step`` needs ``origins``, the objects that caused each detection."""
        return self.associate.method == "oracle"

    @cached_property
    def _track_filter(self) -> TrackFilter:
        if self.engine == "numpy":
            return TrackFilter(self.computed_filter, self.initial)
        # The import is slow.
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
        """Predict to the scan's time, associate its detections, and begin and end tracks.

        A scan that is older than the state is dropped; the tracks then refer to the state's time.

        Args:
            state: state after the previous scan; None at the first scan.
            scan: scan of one run (``measurement`` ``(m, D)``) or of many runs (``(m, D, runs)``).
            origins: ``(2, D)`` or ``(2, D, runs)`` numbers of the object that caused each detection, and of a second
                object merged with it; negative for none. For the oracle only.
        """
        if scan.valid.ndim == 1:
            single = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[:, None])
            state, tracks = self.step(state, single, None if origins is None else origins[..., None])
            return state, _single_run(tracks)
        scan, runs = self.assumed.stated(scan), scan.valid.shape[1]
        if state is None:
            table, undetected = self._manager.empty_table(), Undetected(self.associate.undetected, {})
            if scan.asked:
                # The first scan may not have arrived yet.
                return None, self._tracks(table, runs)
            state = MultiObjectState(scan.time, table, np.zeros(runs, dtype=np.intp), undetected)
        if scan.asked or (self.sensors is not None and not self.reads(scan.sensor)):
            later, answer = self._prediction(state, max(scan.time, state.time))
            return (later if self.advance_at == "all_scans" and not scan.asked else state), answer
        if scan.time < state.time:
            return state, self._prediction(state, state.time)[1]
        return self._in_sequence(state, scan, origins)

    def _in_sequence(
        self, state: MultiObjectState, scan: Scan, origins: Indices | None = None
    ) -> tuple[MultiObjectState, Tracks]:
        at_tracks = with_sensor_of(scan, state.table.run)
        expected = self._track_filter.expect(state.table.belief, scan.time - state.time, at_tracks)
        later = self._at(state, scan.time)
        config, runs = self.associate, len(later.next_id)
        detections = run_detections(scan, as_listed=config.method == "naive")
        if self.assumed.effects:
            detections = detections._replace(scan=self.assumed.with_noise_by_range(detections.scan))
        of_tracks, of_detections = self._detectability.probabilities(
            self._track_filter.filter, expected.belief, at_tracks, detections.scan
        )
        origin = None if origins is None else origins[:, detections.column, detections.run]
        in_view, measured = later.undetected.in_view(scan.sensor), self._track_filter.measured(detections.scan)
        density = intensity(
            detections.scan,
            measured.value is detections.scan.measurement,
            config,
            in_view[detections.run] if isinstance(in_view, np.ndarray) else in_view,
            of_detections,
            self.initial.velocity_sigma_mps,
        )
        probability = np.where(expected.in_view, of_tracks, 0.0)
        inputs = AssociationInput(
            self._track_filter, expected, detections, measured, later.table.run, probability, config.gate, density
        )
        result = associated(config, inputs, later.table, origin, of_tracks, self._manager.compute)
        table, is_ending = self._manager.after_scan(later.table, result, inputs)
        may_begin = self.initial.sensors is None or scan.sensor in self.initial.sensors
        may_begin &= SENSOR_MODELS[scan.kind].measures_position()
        new_tracks = self._manager.new_tracks(inputs, result.unclaimed, origin) if may_begin else None
        table = with_new_tracks(table, ~is_ending, new_tracks)
        table, next_id = with_ids(table, self._manager.logic.confirms(table.evidence), later.next_id)
        undetected = later.undetected
        if config.method in EXISTENCE:
            detects = self._detectability.stated(scan), self._detectability.half_range_m(scan)
            undetected = undetected.after_scan(scan, *detects)
        after = MultiObjectState(scan.time, table, next_id, undetected, expected.belief, later.table)
        return after, self._tracks(table, runs)

    def _prediction(self, state: MultiObjectState, time: float) -> tuple[MultiObjectState, Tracks]:
        later, belief = self._at(state, time), state.table.belief
        if len(state.table.run):
            belief = compact(self._track_filter.filter.predict(belief, time - state.time))
        later = later._replace(table=later.table._replace(belief=belief))
        table = later.table._replace(used=np.full_like(later.table.used, NONE))
        return later, self._tracks(table, len(later.next_id))

    def predicted(self, state: MultiObjectState, run: int) -> Tracks:
        """Return the K tracks of one run predicted to the latest scan, before its detections are used."""
        assert state.before is not None
        assert state.expected is not None
        table = state.before._replace(belief=compact(state.expected)).select(state.before.run == run)
        return _single_run(
            self._tracks(table._replace(run=np.zeros_like(table.run), used=np.full_like(table.used, NONE)), 1)
        )

    def _at(self, state: MultiObjectState, time: float) -> MultiObjectState:
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


def _single_run(tracks: Tracks) -> Tracks:
    return Tracks._make(None if part is None else part[..., 0] for part in tracks)


def build_multi(config: FilterConfig) -> LateScans:
    """Return the multi-object tracker that a scenario's settings ``filter:`` and ``associate:`` describe."""
    assert config.associate is not None
    tracker = MultiObjectTracker(filter_of(config), config.initial, associate=config.associate, **config.scan_options)
    return LateScans(tracker, config.late, config.lag_s)

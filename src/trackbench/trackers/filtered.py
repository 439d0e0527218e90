"""A tracker that runs one of the built-in filters."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.engine.choice import Engine, used
from trackbench.engine.equations import EngineUsed
from trackbench.filters import Filter, choose
from trackbench.models.motion import Kinematics
from trackbench.trackers import initial
from trackbench.trackers.cartesian_fallback import FallbackFilter, has_yaw
from trackbench.trackers.config import AdvanceAt, AssumedSensors
from trackbench.trackers.in_order import InOrder, TrackState
from trackbench.trackers.initial import Prior
from trackbench.trackers.initial_config import InitialConfig
from trackbench.trackers.late import LateMethod, ProcessedScan, appended, position
from trackbench.trackers.out_of_sequence import after_replay, after_retrodiction


@dataclass(frozen=True)
class FilterTracker:
    """Runs a filter on a batch of objects: starts each track, predicts to each scan, updates where it is valid.

    At a scan of a sensor that it does not read, the estimate is a prediction from its last own scan, and is not kept.
    So no estimate depends on a sensor that is not read.
    """

    filter: Filter[Any]
    initial: InitialConfig
    prior: Prior | None = None
    """Set by the bench where ``initial`` says that tracks start from the truth."""
    assumed: AssumedSensors = field(default_factory=AssumedSensors)
    sensors: Collection[str] | None = None
    """Names of the sensors whose measurements update the tracks; None: all."""
    advance_at: AdvanceAt = "own_scans"
    late: LateMethod = "replay"
    """What becomes of a scan that is older than the state."""
    lag_s: float = 1.0
    """How far back a late scan may reach, s."""
    cartesian_fallback: Literal["always", "at_start", "never"] = "always"
    """When a track of a state with a yaw is followed by position and velocity, because its course is unknown."""
    engine: Engine = "numpy"

    batched: ClassVar = True

    def step(self, state: TrackState | None, scan: Scan) -> tuple[TrackState, Estimate]:
        """Predict to the scan's time, and update with its measurements if the tracker reads its sensor.

        A scan that is older than the state is processed as ``late`` says; the estimate is then that at the state's
        time.
        """
        scan = self.assumed.read(scan)
        if state is None:
            state = self._in_order.empty(scan.valid)
        if scan.asked or not self.advances(scan.sensor):
            return state, self.estimate(self.predicted(state, scan.time))
        if self.late == "as_new":
            scan = scan._replace(time=scan.arrival_time)
        number = position(state.history, scan)
        if scan.time < state.time or (number is not None and self.late == "replay"):
            if number is None:
                return state, self.estimate(state)
            method = after_retrodiction if self.late == "retrodiction" else after_replay
            return method(self._in_order, state, scan, number)
        before = state._replace(history=()) if state.history else state
        after, estimate = self._in_order.step(before, scan)
        if self.late not in ("replay", "retrodiction") or self.lag_s == 0.0:
            return after, estimate
        processed = ProcessedScan(before, scan, answer=estimate)
        return after._replace(history=appended(self._in_order.step, state.history, processed, self.lag_s)), estimate

    def advances(self, sensor: str) -> bool:
        """Whether the state moves on at that sensor's scans: it reads them, starts tracks from them, or is told to."""
        read = self.sensors is None or sensor in self.sensors or sensor in (self.initial.sensors or ())
        return read or self.advance_at == "all_scans"

    def reading_only(self, sensors: Collection[str] | None) -> FilterTracker:
        """This tracker, which reads no other sensors than these; None: as it is."""
        if sensors is None:
            return self
        return replace(self, sensors=[name for name in sensors if self.sensors is None or name in self.sensors])

    @property
    def starts_from_truth(self) -> bool:
        """Whether the bench is to draw the first states and hand them in by ``with_prior``."""
        return self.initial.source == "truth"

    def with_prior(self, time: Array, motion: Kinematics, normal: Array) -> FilterTracker:
        """This tracker, its tracks starting at the given times from the given motion with a drawn error.

        Args:
            time: ``(...)`` s.
            motion: the true motion at that time, each ``(...)``.
            normal: ``(6 or more, ...)`` standard normal numbers, of which the first ``n`` are used.
        """
        belief = self.filter.begin(lambda model: initial.from_truth(model, self.initial, motion, normal))
        return replace(self, prior=Prior(time, belief))

    @property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return self._in_order.computed_filter

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        return used(self.computed_filter)

    def predicted(self, state: TrackState, time: float) -> TrackState:
        """The state predicted to a time at which it does not advance."""
        return self._in_order.predicted(state, time)

    def estimate(self, state: TrackState) -> Estimate:
        """The estimate of all objects, also of those whose tracks have not started."""
        return self._in_order.estimate(state)

    def smoothed(self, state: TrackState, later: TrackState) -> TrackState:
        """The state smoothed by a later one, by that of Rauch, Tung and Striebel."""
        elapsed = later.time - state.time
        # Where there is no track yet, what is smoothed means nothing.
        belief = choose(state.started, self.computed_filter.smooth(state.belief, later.belief, elapsed), state.belief)
        if state.fallback is None:
            return state._replace(belief=belief)
        known = self.estimate(later)
        fallback = self._in_order.fallback
        both = fallback.smoothed(state.fallback, elapsed, Gaussian(known.mean, known.covariance), belief)
        return state._replace(belief=both[0], fallback=both[1])

    @cached_property
    def _in_order(self) -> InOrder:
        config, motions = self.initial, self.filter.motions
        # A stated covariance is that of the motion model's own state.
        possible = has_yaw(motions) and config.source != "truth" and config.covariance_diag is None
        at_start = possible and self.cartesian_fallback != "never"
        later = possible and self.cartesian_fallback == "always"
        fallback = FallbackFilter(self.filter, self.engine, initial.sigmas(config), at_start, later)
        return InOrder(self.filter, self.engine, config, self.prior, self.sensors, fallback)

"""Trackers that run a built-in filter: prediction, update, start of tracks, and smoothing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import Any, ClassVar, Literal

import numpy as np

from trackbench.base.types import Array, Estimate, Gaussian, Mask, Scan
from trackbench.engine.choice import Engine, engine_used_by, filter_by
from trackbench.engine.equations import EngineUsed
from trackbench.filters import Filter, Step, StepGuard, Update, choose, compact
from trackbench.models.motion import Kinematics
from trackbench.models.motion.base import YAW
from trackbench.trackers import initial
from trackbench.trackers.assume import AssumedSensors
from trackbench.trackers.cartesian_fallback import CartesianFallback, FallbackFilter
from trackbench.trackers.config import AdvanceAt
from trackbench.trackers.initial import InitialConfig, Prior
from trackbench.trackers.track_steps import TrackState, belief_estimate, chosen_update, where_tracked, with_innovation


@dataclass(frozen=True)
class BuiltInTracker:
    """Filter, and rules for the use of scans, that the built-in single-object and multi-object trackers share."""

    filter: Filter[Any]
    initial: InitialConfig
    assumed: AssumedSensors = field(default_factory=AssumedSensors)
    sensors: Collection[str] | None = None
    """Names of the sensors whose measurements update the tracks; None for all."""
    advance_at: AdvanceAt = "own_scans"
    engine: Engine = "numpy"

    batched: ClassVar = True

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """Filter whose steps the tracker's engine computes."""
        return filter_by(self.engine, self.filter)

    @property
    def engine_used(self) -> EngineUsed:
        """Engine that computed the steps so far, and why not the fused one."""
        return engine_used_by(self.computed_filter)

    @property
    def starts_from_truth(self) -> bool:
        """Whether the tracks start from the ground truth, with first states that the bench passes to ``with_prior``."""
        return self.initial.source == "truth"

    def reads(self, sensor: str) -> bool:
        """Return whether measurements of a sensor update or start tracks."""
        return self.sensors is None or sensor in self.sensors or sensor in (self.initial.sensors or ())

    def advances(self, sensor: str) -> bool:
        """Return whether a scan of a sensor moves the state to the scan's time."""
        return self.advance_at == "all_scans" or self.reads(sensor)


@dataclass(frozen=True)
class FilterTracker(BuiltInTracker):
    """Tracker of a batch of objects that starts each track, predicts to each scan and updates with valid measurements.

    At a scan of an unused sensor, the estimate is a prediction from the last used scan, and the state stays. So no
    estimate depends on an unused sensor.
    """

    prior: Prior | None = None
    """First state of each track, set by the bench if tracks start from the truth; else None."""
    cartesian_fallback: Literal["always", "at_start", "never"] = "always"
    """When a track's position and velocity replace a state with a yaw, if its course is unknown."""

    def step(self, state: TrackState | None, scan: Scan) -> tuple[TrackState, Estimate]:
        """Predict to the scan's time, and update with the scan if the tracker uses its sensor.

        A scan that is older than the state is dropped; the estimate then refers to the state's time.
        """
        scan = self.assumed.read(scan)
        if state is None:
            belief = self.filter.begin(lambda motion: initial.placeholder(motion, scan.valid.shape))
            state = TrackState(-np.inf, belief, np.zeros_like(scan.valid))
        if scan.asked or not self.advances(scan.sensor):
            return state, self.estimate(self.predicted(state, scan.time))
        if scan.time < state.time:
            return state, self.estimate(state)
        return self._in_sequence(state, scan)

    def reading_only(self, sensors: Collection[str] | None) -> FilterTracker:
        """Return this tracker restricted to the named sensors; this tracker itself for None."""
        if sensors is None:
            return self
        return replace(self, sensors=[name for name in sensors if self.sensors is None or name in self.sensors])

    def with_prior(self, time: Array, motion: Kinematics, normal: Array) -> FilterTracker:
        """Return a copy whose tracks start at given times from the true motion plus a drawn error.

        Args:
            time: ``(...)`` start of each track, s.
            motion: true motion of each object ``(...)`` at the start of its track.
            normal: ``(6 or more, ...)`` standard normal draws; the first ``n`` rows are used, for the state's ``n``
                components.
        """
        belief = self.filter.begin(lambda model: initial.from_truth(model, self.initial, motion, normal))
        return replace(self, prior=Prior(time, belief))

    def _in_sequence(self, state: TrackState, scan: Scan) -> tuple[TrackState, Estimate]:
        has_measurement = bool(np.any(scan.valid))
        # Without a measurement, the kernels of a step and of a prediction differ in the last bits.
        reads = (self.sensors is None or scan.sensor in self.sensors) and (has_measurement or self.engine == "fused")
        step, is_own = self._predicted_and_updated(state, scan) if reads else (None, state.started)
        if step is not None and np.all(is_own):
            belief = step.update.belief
            estimate = belief_estimate(belief, step.cartesian)
            estimate = with_innovation(estimate, step.update) if has_measurement else estimate
            return state._replace(time=scan.time, belief=belief._replace(repaired=None)), estimate
        after, update = self._filtered(state, scan, reads, step, is_own)
        tracked = after.started
        starting = self.initial.sensors or self.sensors
        if self.prior is None and (starting is None or scan.sensor in starting):
            after = self.with_starts(after, scan)
        if after.fallback is not None:
            belief, fallback = self.fallback.returned(after.fallback, after.belief)
            after = after._replace(belief=belief, fallback=fallback)
        estimate = self.estimate(after)
        if step is not None:
            mean, covariance = step.cartesian
            estimate = estimate._replace(
                mean=np.where(is_own, mean, estimate.mean), covariance=np.where(is_own, covariance, estimate.covariance)
            )
        if update is not None and has_measurement:
            estimate = with_innovation(estimate, update, tracked)
        return after._replace(belief=after.belief._replace(repaired=None)), estimate

    def _predicted_and_updated(self, state: TrackState, scan: Scan) -> tuple[Step[Any] | None, Mask]:
        """Return the fused prediction and update, and a mask of the tracks it is right for: all outside the fallback.

        The step of a track does not depend on other tracks, so that their number changes no bit of an estimate.
        """
        is_own = state.started if state.fallback is None else state.started & ~state.fallback.where
        if not np.any(is_own):
            return None, is_own
        filter: Any = self.computed_filter
        elapsed, guard = scan.time - state.time, self.guard
        if self.engine == "fused":
            step: Step[Any] = filter.step(state.belief, elapsed, scan, guard)
        else:
            predicted = filter.predict(state.belief, elapsed)
            update = filter.update(predicted, scan)
            step = Step(update, filter.cartesian(update.belief), None if guard is None else guard(predicted))
        return step, is_own if step.refused is None else is_own & ~step.refused

    def _filtered(
        self, state: TrackState, scan: Scan, is_read: bool, step: Step[Any] | None, is_own: Mask
    ) -> tuple[TrackState, Update[Any] | None]:
        """Return the state at the time of a scan, and the update with it if the tracker uses the sensor.

        ``step``, if any, is the fused prediction and update, right for tracks in the mask ``is_own`` ``(...)``.
        """
        fallback = state.fallback
        is_expected = state.started if fallback is None else state.started & ~fallback.where
        if step is not None and self.prior is None and np.array_equal(is_own, is_expected):
            update = step.update
            if fallback is not None:
                # No track loses its course, so only the fallback needs an update.
                fallback = self.fallback.predicted(
                    fallback, scan.time - state.time, state.belief, np.zeros_like(is_own)
                )
                assert fallback is not None
                update, fallback = self.fallback.updated(fallback, scan, lambda _: step.update)
            belief = choose(state.started, update.belief, state.belief)
            return state._replace(time=scan.time, belief=belief, fallback=fallback), update
        state = self.advanced(state, scan.time)
        if self.prior is not None:
            filter = self.computed_filter
            belief, started = self.prior.begin(scan.time, state.belief, state.started, filter)
            state = state._replace(belief=belief, started=started)
        if not is_read:
            return state, None
        update, fallback = self.updated(state, scan)
        if step is not None:
            update = chosen_update(is_own, step.update, update)
            fallback = None if fallback is None else fallback._replace(where=fallback.where & ~is_own)
        return state._replace(belief=update.belief, fallback=fallback), update

    @cached_property
    def fallback(self) -> FallbackFilter:
        """Filter on px, py, vx, vy of the tracks whose course is unknown."""
        has_yaw = any(set(YAW) & set(motion.components) for motion in self.filter.motions)
        # A configured covariance belongs to the state of the motion model.
        is_possible = has_yaw and self.initial.source != "truth" and self.initial.covariance_diag is None
        at_start = is_possible and self.cartesian_fallback != "never"
        later = is_possible and self.cartesian_fallback == "always"
        return FallbackFilter(self.filter, self.engine, initial.sigmas(self.initial), at_start, later)

    @property
    def guard(self) -> StepGuard | None:
        """Test for tracks whose course gets lost, to be followed by position and velocity; None if not allowed."""
        return self.fallback.guard

    def advanced(self, state: TrackState, time: float) -> TrackState:
        """Return the state predicted to ``time``, which is not before the state's time."""
        elapsed, belief, started = time - state.time, state.belief, state.started
        if np.any(started):
            belief = self.computed_filter.predict(belief, elapsed)
            if not np.all(started):
                # A placeholder is not predicted, so that its covariance does not grow without bound.
                belief = choose(started, belief, state.belief)
        fallback = self.fallback.predicted(state.fallback, elapsed, belief, started)
        return state._replace(time=time, belief=belief, fallback=fallback)

    def predicted(self, state: TrackState, time: float) -> TrackState:
        """Return the state predicted to ``time``; an earlier time leaves the state unchanged."""
        # A prediction over no time would compute new sigma points, and change the last digits.
        return state if time <= state.time else self.advanced(state, time)

    def updated(self, state: TrackState, scan: Scan) -> tuple[Update[Any], CartesianFallback | None]:
        """Update all tracks with a scan at the state's time; return also the tracks of unknown course, None if none."""
        if state.fallback is None:
            # Placeholders alone do not justify compiling a kernel.
            filter = self.computed_filter if np.any(state.started) else self.filter
            return filter.update(state.belief, scan), None
        return self.fallback.updated(state.fallback, scan, lambda part: self.computed_filter.update(state.belief, part))

    def with_starts(self, state: TrackState, scan: Scan) -> TrackState:
        """Return the state, with those tracks started that can start from the measurements of a scan."""
        if np.all(state.started):
            return state
        begin = initial.start_tracks(self.initial, scan, state.waiting)
        fresh, belief, fallback = begin.ready & ~state.started, state.belief, state.fallback
        if np.any(fresh):
            belief = choose(fresh, self.filter.begin(begin.state_of), belief)
            fallback = self.fallback.begun(fallback, fresh, begin.state_of)
        return state._replace(belief=belief, started=state.started | fresh, waiting=begin.waiting, fallback=fallback)

    def estimate(self, state: TrackState) -> Estimate:
        """Return the estimate of a state; for a track not yet started NaN, or its latest measurement if configured."""
        started, fallback = state.started, state.fallback
        mean, covariance = self.computed_filter.cartesian(state.belief)
        if fallback is not None:
            mean = np.where(fallback.where, fallback.belief.mean, mean)
            covariance = np.where(fallback.where, fallback.belief.covariance, covariance)
        if not np.all(started):
            before: Gaussian | tuple[float, float] = (np.nan, np.nan)
            if state.waiting is not None and self.initial.waiting == "at_rest":
                before = initial.at_rest(state.waiting, self.initial)
            mean = np.where(started, mean, before[0])
            covariance = np.where(started, covariance, before[1])
        estimate = belief_estimate(state.belief, Gaussian(mean, covariance))
        if estimate.mode_probabilities is not None:
            estimate = estimate._replace(mode_probabilities=where_tracked(started, estimate.mode_probabilities))
        return estimate if estimate.repaired is None else estimate._replace(repaired=estimate.repaired & started)

    def smoothed(self, state: TrackState, later: TrackState) -> TrackState:
        """Return the state smoothed by the smoothed state at a later time (Rauch-Tung-Striebel)."""
        elapsed = later.time - state.time
        # The smoothed belief is meaningless before a track has started.
        belief = choose(state.started, self.computed_filter.smooth(state.belief, later.belief, elapsed), state.belief)
        fallback = state.fallback
        if fallback is not None:
            estimate = self.estimate(later)
            cartesian = Gaussian(estimate.mean, estimate.covariance)
            belief, fallback = self.fallback.smoothed(fallback, elapsed, cartesian, belief)
        return state._replace(belief=belief, fallback=fallback)


@dataclass(frozen=True)
class SmoothedTracker:
    """Smoother that wraps a tracker: each estimate uses all measurements, earlier and later ones.

    Tracks start as in the wrapped tracker. Predictions between two used scans are smoothed by the later one.
    """

    tracker: FilterTracker

    def __post_init__(self) -> None:
        # The smoother cannot go back from position and velocity to the state before a track lost its course.
        if self.tracker.cartesian_fallback == "always":
            object.__setattr__(self, "tracker", replace(self.tracker, cartesian_fallback="at_start"))

    def estimates(self, scans: Sequence[Scan]) -> list[Estimate]:
        """Return the smoothed estimate at each scan's time; late scans are used as if without delay."""
        instants = self._filtered(sorted((scan.prompt() for scan in scans), key=lambda scan: scan.time))
        smoothed: dict[float, Estimate] = {}
        later: TrackState | None = None
        while instants:
            state, is_used = instants.pop()
            if later is not None:
                state = self.tracker.smoothed(state, later)
            # The filter's own state is not scored and would double the memory.
            smoothed[state.time] = self.tracker.estimate(state)._replace(state=None, state_covariance=None)
            if is_used:
                later = state
        return [smoothed[scan.time] for scan in scans]

    def _filtered(self, scans: Sequence[Scan]) -> list[tuple[TrackState, bool]]:
        tracker = self.tracker
        state: TrackState | None = None
        instants = []
        for time, group in groupby(scans, key=lambda scan: scan.time):
            is_used = False
            for scan in group:
                state, _ = tracker.step(state, scan)
                is_used = is_used or tracker.advances(scan.sensor)
            assert state is not None
            at_time = state if is_used else tracker.predicted(state, time)
            instants.append((at_time._replace(time=time, belief=compact(at_time.belief)), is_used))
        return instants

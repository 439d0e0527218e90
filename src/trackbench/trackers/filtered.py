"""A tracker that runs one of the built-in filters: prediction, update, start of tracks; its smoother."""

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
    """What the built-in trackers of one object and of several have in common: a filter, and the scans that it takes."""

    filter: Filter[Any]
    initial: InitialConfig
    assumed: AssumedSensors = field(default_factory=AssumedSensors)
    sensors: Collection[str] | None = None
    """Names of the sensors whose measurements update the tracks; None: all."""
    advance_at: AdvanceAt = "own_scans"
    engine: Engine = "numpy"

    batched: ClassVar = True

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return filter_by(self.engine, self.filter)

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        return engine_used_by(self.computed_filter)

    @property
    def starts_from_truth(self) -> bool:
        """Whether the bench is to draw the first states and hand them in by ``with_prior``."""
        return self.initial.source == "truth"

    def reads(self, sensor: str) -> bool:
        """Whether the sensor's measurements update or start tracks."""
        return self.sensors is None or sensor in self.sensors or sensor in (self.initial.sensors or ())

    def advances(self, sensor: str) -> bool:
        """Whether the state moves on at that sensor's scans: it reads them, starts tracks from them, or is set to."""
        return self.advance_at == "all_scans" or self.reads(sensor)


@dataclass(frozen=True)
class FilterTracker(BuiltInTracker):
    """Runs a filter on a batch of objects: starts each track, predicts to each scan, updates where it is valid.

    At a scan of a sensor that it does not read, the estimate is a prediction from its last own scan, and is not kept.
    So no estimate depends on a sensor that is not read.
    """

    prior: Prior | None = None
    """Set by the bench where ``initial`` says that tracks start from the truth."""
    cartesian_fallback: Literal["always", "at_start", "never"] = "always"
    """When a track of a state with a yaw is followed by position and velocity, because its course is unknown."""

    def step(self, state: TrackState | None, scan: Scan) -> tuple[TrackState, Estimate]:
        """Predict to the scan's time, and update with its measurements if the tracker reads its sensor.

        A scan that is older than the state is dropped; the estimate is then that at the state's time.
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
        """This tracker, which reads no other sensors than these; None: as it is."""
        if sensors is None:
            return self
        return replace(self, sensors=[name for name in sensors if self.sensors is None or name in self.sensors])

    def with_prior(self, time: Array, motion: Kinematics, normal: Array) -> FilterTracker:
        """This tracker, its tracks starting at the given times from the given motion with a drawn error.

        Args:
            time: ``(...)`` s.
            motion: the true motion at that time, each ``(...)``.
            normal: ``(6 or more, ...)`` standard normal numbers, of which the first ``n`` are used.
        """
        belief = self.filter.begin(lambda model: initial.from_truth(model, self.initial, motion, normal))
        return replace(self, prior=Prior(time, belief))

    def _in_sequence(self, state: TrackState, scan: Scan) -> tuple[TrackState, Estimate]:
        some = bool(np.any(scan.valid))
        # Without a measurement the kernel of a step gives other last bits than that of a prediction.
        reads = (self.sensors is None or scan.sensor in self.sensors) and (some or self.engine == "fused")
        step, own = self._predicted_and_updated(state, scan) if reads else (None, state.started)
        if step is not None and np.all(own):
            belief = step.update.belief
            estimate = belief_estimate(belief, step.cartesian)
            estimate = with_innovation(estimate, step.update) if some else estimate
            return state._replace(time=scan.time, belief=belief._replace(repaired=None)), estimate
        after, update = self._filtered(state, scan, reads, step, own)
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
                mean=np.where(own, mean, estimate.mean), covariance=np.where(own, covariance, estimate.covariance)
            )
        if update is not None and some:
            estimate = with_innovation(estimate, update, tracked)
        return after._replace(belief=after.belief._replace(repaired=None)), estimate

    def _predicted_and_updated(self, state: TrackState, scan: Scan) -> tuple[Step[Any] | None, Mask]:
        """Prediction and update at once, and of which tracks: not those that are, or would be, in the fallback.

        It does not depend on the other tracks of the batch, so that their number changes no bit of an estimate.
        """
        own = state.started if state.fallback is None else state.started & ~state.fallback.where
        if not np.any(own):
            return None, own
        filter: Any = self.computed_filter
        elapsed, guard = scan.time - state.time, self.guard
        if self.engine == "fused":
            step: Step[Any] = filter.step(state.belief, elapsed, scan, guard)
        else:
            predicted = filter.predict(state.belief, elapsed)
            update = filter.update(predicted, scan)
            step = Step(update, filter.cartesian(update.belief), None if guard is None else guard(predicted))
        return step, own if step.refused is None else own & ~step.refused

    def _filtered(
        self, state: TrackState, scan: Scan, reads: bool, step: Step[Any] | None, own: Mask
    ) -> tuple[TrackState, Update[Any] | None]:
        """The tracks at the time of a scan, and their update if its measurements are read.

        ``step``: prediction and update at once of the tracks ``own`` ``(...)``; None: of none.
        """
        fallback = state.fallback
        expected = state.started if fallback is None else state.started & ~fallback.where
        if step is not None and self.prior is None and np.array_equal(own, expected):
            update = step.update
            if fallback is not None:
                # No track loses its course: the fallback alone is left.
                fallback = self.fallback.predicted(fallback, scan.time - state.time, state.belief, np.zeros_like(own))
                assert fallback is not None
                update, fallback = self.fallback.updated(fallback, scan, lambda _: step.update)
            belief = choose(state.started, update.belief, state.belief)
            return state._replace(time=scan.time, belief=belief, fallback=fallback), update
        state = self.advanced(state, scan.time)
        if self.prior is not None:
            filter = self.computed_filter
            belief, started = self.prior.begin(scan.time, state.belief, state.started, filter)
            state = state._replace(belief=belief, started=started)
        if not reads:
            return state, None
        update, fallback = self.updated(state, scan)
        if step is not None:
            update = chosen_update(own, step.update, update)
            fallback = None if fallback is None else fallback._replace(where=fallback.where & ~own)
        return state._replace(belief=update.belief, fallback=fallback), update

    @cached_property
    def fallback(self) -> FallbackFilter:
        """Follows the tracks whose course is unknown."""
        with_yaw = any(set(YAW) & set(motion.components) for motion in self.filter.motions)
        # A stated covariance is that of the motion model's own state.
        possible = with_yaw and self.initial.source != "truth" and self.initial.covariance_diag is None
        at_start = possible and self.cartesian_fallback != "never"
        later = possible and self.cartesian_fallback == "always"
        return FallbackFilter(self.filter, self.engine, initial.sigmas(self.initial), at_start, later)

    @property
    def guard(self) -> StepGuard | None:
        """Tells of a predicted belief where a step is not the filter's alone."""
        return self.fallback.guard

    def advanced(self, state: TrackState, time: float) -> TrackState:
        """The state predicted to a later time, or to its own."""
        elapsed, belief, started = time - state.time, state.belief, state.started
        if np.any(started):
            belief = self.computed_filter.predict(belief, elapsed)
            if not np.all(started):
                # A placeholder stays as it is, so that its covariance does not grow without bound.
                belief = choose(started, belief, state.belief)
        fallback = self.fallback.predicted(state.fallback, elapsed, belief, started)
        return state._replace(time=time, belief=belief, fallback=fallback)

    def predicted(self, state: TrackState, time: float) -> TrackState:
        """The state predicted to a time at which it does not advance."""
        # A prediction over no time would draw sigma points anew, and change the last digits.
        return state if time <= state.time else self.advanced(state, time)

    def updated(self, state: TrackState, scan: Scan) -> tuple[Update[Any], CartesianFallback | None]:
        """The update of all tracks with a scan at the time of their state, and the fallback after it."""
        if state.fallback is None:
            # For placeholders alone nothing is compiled.
            filter = self.computed_filter if np.any(state.started) else self.filter
            return filter.update(state.belief, scan), None
        return self.fallback.updated(state.fallback, scan, lambda part: self.computed_filter.update(state.belief, part))

    def with_starts(self, state: TrackState, scan: Scan) -> TrackState:
        """The state with the tracks that start from the measurements of a scan."""
        if np.all(state.started):
            return state
        begin = initial.start_tracks(self.initial, scan, state.waiting)
        fresh, belief, fallback = begin.ready & ~state.started, state.belief, state.fallback
        if np.any(fresh):
            belief = choose(fresh, self.filter.begin(begin.state_of), belief)
            fallback = self.fallback.begun(fallback, fresh, begin.state_of)
        return state._replace(belief=belief, started=state.started | fresh, waiting=begin.waiting, fallback=fallback)

    def estimate(self, state: TrackState) -> Estimate:
        """The estimate of a state; NaN, or at rest if so configured, where no track has started."""
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
        """The state smoothed by a later one, by that of Rauch, Tung and Striebel."""
        elapsed = later.time - state.time
        # Where there is no track yet, what is smoothed means nothing.
        belief = choose(state.started, self.computed_filter.smooth(state.belief, later.belief, elapsed), state.belief)
        fallback = state.fallback
        if fallback is not None:
            estimate = self.estimate(later)
            cartesian = Gaussian(estimate.mean, estimate.covariance)
            belief, fallback = self.fallback.smoothed(fallback, elapsed, cartesian, belief)
        return state._replace(belief=belief, fallback=fallback)


@dataclass(frozen=True)
class SmoothedTracker:
    """The estimates of a tracker, each given the measurements after it too. Tracks start where the tracker starts them.

    Between two scans that it reads, what is predicted from the earlier is smoothed by the later.
    """

    tracker: FilterTracker

    def __post_init__(self) -> None:
        # Where a track loses its course, there is no way back from position and velocity.
        if self.tracker.cartesian_fallback == "always":
            object.__setattr__(self, "tracker", replace(self.tracker, cartesian_fallback="at_start"))

    def estimates(self, scans: Sequence[Scan]) -> list[Estimate]:
        """The estimate at each scan, whatever their order: offline none comes late."""
        instants = self._filtered(sorted((scan.prompt() for scan in scans), key=lambda scan: scan.time))
        smoothed: dict[float, Estimate] = {}
        later: TrackState | None = None
        while instants:
            state, own = instants.pop()
            if later is not None:
                state = self.tracker.smoothed(state, later)
            # The filter's own state, of which nothing is scored, would take as much memory again.
            smoothed[state.time] = self.tracker.estimate(state)._replace(state=None, state_covariance=None)
            if own:
                later = state
        return [smoothed[scan.time] for scan in scans]

    def _filtered(self, scans: Sequence[Scan]) -> list[tuple[TrackState, bool]]:
        """The state at each time, and whether there was a scan that the filter reads; else it is a prediction."""
        tracker = self.tracker
        state: TrackState | None = None
        instants = []
        for time, group in groupby(scans, key=lambda scan: scan.time):
            own = False
            for scan in group:
                state, _ = tracker.step(state, scan)
                own = own or tracker.advances(scan.sensor)
            assert state is not None
            seen = state if own else tracker.predicted(state, time)
            instants.append((seen._replace(time=time, belief=compact(seen.belief)), own))
        return instants

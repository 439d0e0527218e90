"""A tracker that runs one of the built-in filters: prediction, update, start of tracks, late scans; its smoother."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Indices, Mask, Scan
from trackbench.engine.choice import filter_by, used
from trackbench.engine.equations import EngineUsed
from trackbench.filters import (
    AnyBelief,
    Belief,
    Filter,
    MultiModelBelief,
    SingleModelFilter,
    Step,
    StepGuard,
    Update,
    bare,
    choose,
)
from trackbench.models.motion import Kinematics
from trackbench.models.motion.base import YAW
from trackbench.trackers import initial
from trackbench.trackers.cartesian_fallback import CartesianFallback, FallbackFilter
from trackbench.trackers.initial import Prior, TentativeTrack
from trackbench.trackers.late import ProcessedScan, ScanTracker, replayed, up_to_date
from trackbench.trackers.retrodiction import Retrodiction, retrodicted


def estimate_of(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """The estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], tracked: Mask | None) -> Estimate:
    """The estimate with the innovation of its measurement.

    Args:
        estimate: after the measurement.
        update: by it.
        tracked: ``(...)`` where there was a track before the measurement; None: everywhere.
    """
    return estimate._replace(
        innovation=where_tracked(tracked, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_tracked(tracked, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_tracked(tracked, update.mixture),
    )


def chosen_update(where: Mask, first: Update[Any], second: Update[Any]) -> Update[Any]:
    """The first update where it holds, the second elsewhere."""
    mixture = (
        None if first.mixture is None or second.mixture is None else np.where(where, first.mixture, second.mixture)
    )
    return Update(
        choose(where, first.belief, second.belief),
        np.where(where, first.innovation, second.innovation),
        np.where(where, first.innovation_covariance, second.innovation_covariance),
        np.where(where, first.whitened_innovation, second.whitened_innovation),
        mixture=mixture,
    )


def where_tracked(tracked: Mask | None, values: Array) -> Array:
    """The values, NaN where there is no track; None: there is one everywhere."""
    return values if tracked is None or np.all(tracked) else np.where(tracked, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """``(batch,)`` log density of the measurement under the prediction, ``N(y; 0, S)`` of innovation and covariance.

    NaN where there was no prediction; None where the estimate has no innovation.
    """
    if estimate.log_likelihood is not None:
        return np.asarray(estimate.log_likelihood)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


def total_log_likelihood(history: Sequence[ProcessedScan[Any, Estimate]]) -> Array | float:
    """``(batch,)`` log density of all measurements of some scans."""
    total: Array | float = 0.0
    for processed in history:
        logarithm = None if processed.answer is None else log_likelihood(processed.answer)
        if logarithm is not None:
            total = total + np.where(processed.scan.valid & ~np.isnan(logarithm), logarithm, 0.0)
    return total


class TrackState(NamedTuple):
    """The state of a built-in tracker after a scan."""

    time: float
    """Of the latest scan at which the state advanced, s."""
    belief: AnyBelief
    started: Mask
    """``(...)`` where there is a track; elsewhere the belief is a placeholder."""
    waiting: TentativeTrack | None = None
    fallback: CartesianFallback | None = None
    """The tracks whose course is unknown; it replaces their belief."""
    history: tuple[ProcessedScan[TrackState, Estimate], ...] = ()
    """The latest scans, where late ones may come."""


@dataclass(frozen=True)
class FilterTracker(ScanTracker):
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

        A scan that is older than the state is processed as ``late`` says; the estimate is then that at the state's
        time.
        """
        scan = self.assumed.read(scan)
        if state is None:
            belief = self.filter.begin(lambda motion: initial.placeholder(motion, scan.valid.shape))
            state = TrackState(-np.inf, belief, np.zeros_like(scan.valid))
        if scan.asked or not self.advances(scan.sensor):
            return state, self.estimate(self.predicted(state, scan.time))
        return self._after_scan(state, scan._replace(time=scan.arrival_time) if self.late == "as_new" else scan)

    def advances(self, sensor: str) -> bool:
        """Whether the state moves on at that sensor's scans: it reads them, starts tracks from them, or is set to."""
        return self.advance_at == "all_scans" or self.reads(sensor)

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

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return filter_by(self.engine, self.filter)

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        return used(self.computed_filter)

    @property
    def guard(self) -> StepGuard | None:
        """Tells of a predicted belief where a step is not the filter's alone."""
        return self._fallback.guard

    def predicted(self, state: TrackState, time: float) -> TrackState:
        """The state predicted to a time at which it does not advance."""
        elapsed = time - state.time
        if elapsed <= 0.0:
            # A prediction over no time would draw sigma points anew, and change the last digits.
            return state
        belief, fallback = self._predicted(state, elapsed)
        return state._replace(time=time, belief=belief, fallback=fallback)

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
        estimate = estimate_of(state.belief, Gaussian(mean, covariance))
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
            belief, fallback = self._fallback.smoothed(fallback, elapsed, cartesian, belief)
        return state._replace(belief=belief, fallback=fallback)

    def _in_sequence(
        self, state: TrackState, scan: Scan, origins: Indices | None = None
    ) -> tuple[TrackState, Estimate]:
        elapsed, started, waiting = scan.time - state.time, state.started, state.waiting
        some = bool(np.any(scan.valid))
        # Without a measurement the kernel of a step gives other last bits than that of a prediction.
        reads = (self.sensors is None or scan.sensor in self.sensors) and (some or self.engine == "fused")
        step, own = self._fused_step(state, scan, elapsed) if reads else (None, started)
        if step is not None and np.all(own):
            belief = step.update.belief
            estimate = estimate_of(belief, step.cartesian)
            estimate = with_innovation(estimate, step.update, None) if some else estimate
            return state._replace(time=scan.time, belief=belief._replace(repaired=None)), estimate
        update: Update[Any] | None = None
        if step is not None and self.prior is None and np.array_equal(own, started):
            update, fallback = step.update, None
            belief = choose(started, update.belief, state.belief)
        else:
            belief, fallback = self._predicted(state, elapsed)
            if self.prior is not None:
                belief, started = self.prior.begin(scan.time, belief, started, self.computed_filter)
            if reads:
                update, fallback = self._updated(belief, fallback, scan, started)
                if step is not None:
                    update = chosen_update(own, step.update, update)
                    fallback = None if fallback is None else fallback._replace(where=fallback.where & ~own)
                belief = update.belief
        before = started
        starting = self.initial.sensors or self.sensors
        if self.prior is None and (starting is None or scan.sensor in starting) and not np.all(started):
            start = initial.start(self.initial, scan, waiting)
            fresh = start.ready & ~started
            if np.any(fresh):
                belief = choose(fresh, self.filter.begin(start.state_of), belief)
                fallback = self._fallback.begun(fallback, fresh, start.state_of)
            started, waiting = started | fresh, start.waiting
        if fallback is not None:
            belief, fallback = self._fallback.returned(fallback, belief)
        after = TrackState(scan.time, belief, started, waiting, fallback)
        estimate = self.estimate(after)
        if step is not None:
            mean, covariance = step.cartesian
            estimate = estimate._replace(
                mean=np.where(own, mean, estimate.mean), covariance=np.where(own, covariance, estimate.covariance)
            )
        if update is not None and some:
            estimate = with_innovation(estimate, update, before)
        return after._replace(belief=belief._replace(repaired=None)), estimate

    def _fused_step(self, state: TrackState, scan: Scan, elapsed: float) -> tuple[Step[Any] | None, Mask]:
        """Prediction and update at once, and of which tracks: not those that are, or would be, in the fallback.

        It does not depend on the other tracks of the batch, so that their number changes no bit of an estimate.
        """
        own = state.started if state.fallback is None else state.started & ~state.fallback.where
        if not np.any(own):
            return None, own
        step = self.computed_filter.step(state.belief, elapsed, scan, self.guard)
        return step, own if step.refused is None else own & ~step.refused

    def _predicted(self, state: TrackState, elapsed: float) -> tuple[AnyBelief, CartesianFallback | None]:
        belief, started = state.belief, state.started
        if np.any(started):
            belief = self.computed_filter.predict(belief, elapsed)
            if not np.all(started):
                # A placeholder stays as it is, so that its covariance does not grow without bound.
                belief = choose(started, belief, state.belief)
        return belief, self._fallback.predicted(state.fallback, elapsed, belief, started)

    def _updated(
        self, belief: AnyBelief, fallback: CartesianFallback | None, scan: Scan, started: Mask
    ) -> tuple[Update[Any], CartesianFallback | None]:
        if fallback is None:
            # For placeholders alone nothing is compiled.
            return (self.computed_filter if np.any(started) else self.filter).update(belief, scan), None
        return self._fallback.updated(fallback, scan, lambda part: self.computed_filter.update(belief, part))

    @cached_property
    def _fallback(self) -> FallbackFilter:
        config = self.initial
        with_yaw = any(set(YAW) & set(motion.components) for motion in self.filter.motions)
        # A stated covariance is that of the motion model's own state.
        possible = with_yaw and config.source != "truth" and config.covariance_diag is None
        at_start = possible and self.cartesian_fallback != "never"
        later = possible and self.cartesian_fallback == "always"
        return FallbackFilter(self.filter, self.engine, initial.sigmas(config), at_start, later)

    def _present(self, state: TrackState) -> Estimate:
        return self.estimate(state)

    def _after_late(
        self, state: TrackState, scan: Scan, origins: Indices | None, number: int
    ) -> tuple[TrackState, Estimate]:
        """The present estimate has the innovation of the late scan."""
        if self.late == "retrodiction":
            return self._after_retrodiction(state, scan, number)
        again = replayed(self._in_sequence, state.history, number, scan)
        late = again.late
        gained = total_log_likelihood(again.history[number:]) - total_log_likelihood(state.history[number:])
        return again.state._replace(history=again.history), again.latest._replace(
            innovation=late.innovation,
            innovation_covariance=late.innovation_covariance,
            whitened_innovation=late.whitened_innovation,
            # Of the late scan given all that were processed before. Zero: no track was there for any of them.
            log_likelihood=np.where(gained == 0.0, np.nan, gained),
        )

    def _after_retrodiction(self, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
        """Correct the present by a late scan, where a track has gone on since before it."""
        history = up_to_date(self._in_sequence, state.history, number)
        before = history[number].before
        going_on = before.started & state.started
        part = scan._replace(valid=going_on & scan.valid)
        if before.fallback is not None or state.fallback is not None or not np.any(part.valid):
            return state._replace(history=history), self.estimate(state)
        assert isinstance(self.filter, SingleModelFilter)
        assert isinstance(before.belief, Belief)
        assert isinstance(state.belief, Belief)
        times = tuple(processed.scan.time for processed in history[number:])
        update = retrodicted(self.filter, Retrodiction(before.belief, before.time, state.belief, times), part)
        after = state._replace(belief=update.belief)
        estimate = with_innovation(self.estimate(after), update, going_on)
        late: ProcessedScan[TrackState, Estimate] = ProcessedScan(before, part)
        # The states after the late scan lack it.
        outdated = (processed._replace(outdated=True) for processed in history[number:])
        history = (*history[:number], late, *outdated)
        return after._replace(belief=update.belief._replace(repaired=None), history=history), estimate


@dataclass(frozen=True)
class SmoothedTracker:
    """The estimates of a tracker, each given the measurements after it too. Tracks start where the tracker starts them.

    Between two scans that it reads, what is predicted from the earlier is smoothed by the later.
    """

    tracker: FilterTracker

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
        # Where a track loses its course, there is no way back from position and velocity.
        when = self.tracker.cartesian_fallback
        tracker = replace(self.tracker, cartesian_fallback="at_start" if when == "always" else when, lag_s=0.0)
        state: TrackState | None = None
        instants = []
        for time, group in groupby(scans, key=lambda scan: scan.time):
            own = False
            for scan in group:
                state, _ = tracker.step(state, scan)
                own = own or tracker.advances(scan.sensor)
            assert state is not None
            seen = state if own else tracker.predicted(state, time)
            instants.append((seen._replace(time=time, belief=bare(seen.belief)), own))
        return instants

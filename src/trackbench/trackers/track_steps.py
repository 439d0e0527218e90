"""The steps of a filter on a batch of tracks: some may not have started, and of some the course may be unknown."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask, Scan
from trackbench.engine.choice import Engine, filter_by
from trackbench.filters import (
    AnyBelief,
    Filter,
    MultiModelBelief,
    StepGuard,
    Update,
    choose,
)
from trackbench.models.motion.base import YAW
from trackbench.trackers.cartesian_fallback import CartesianFallback, FallbackFilter
from trackbench.trackers.initial import InitialConfig, TentativeTrack, at_rest, sigmas, start_tracks


def belief_estimate(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """The estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], tracked: Mask | None = None) -> Estimate:
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


@dataclass(frozen=True)
class TrackSteps:
    """Predicts, updates and smooths a batch of tracks, those of unknown course by position and velocity."""

    filter: Filter[Any]
    """By NumPy."""
    engine: Engine
    initial: InitialConfig
    cartesian_fallback: Literal["always", "at_start", "never"]
    """When a track of a state with a yaw is followed by position and velocity, because its course is unknown."""

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return filter_by(self.engine, self.filter)

    @cached_property
    def fallback(self) -> FallbackFilter:
        """Follows the tracks whose course is unknown."""
        with_yaw = any(set(YAW) & set(motion.components) for motion in self.filter.motions)
        # A stated covariance is that of the motion model's own state.
        possible = with_yaw and self.initial.source != "truth" and self.initial.covariance_diag is None
        at_start = possible and self.cartesian_fallback != "never"
        later = possible and self.cartesian_fallback == "always"
        return FallbackFilter(self.filter, self.engine, sigmas(self.initial), at_start, later)

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
        begin = start_tracks(self.initial, scan, state.waiting)
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
                before = at_rest(state.waiting, self.initial)
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

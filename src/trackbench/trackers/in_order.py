"""Scans in the order of their times, through a filter: prediction, update, start of tracks, and estimates."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Indices, Mask, Scan
from trackbench.engine.choice import Engine, filter_by
from trackbench.filters import AnyBelief, Filter, MultiModelBelief, Step, Update, choose
from trackbench.trackers import initial
from trackbench.trackers.cartesian_fallback import CartesianFallback, FallbackFilter
from trackbench.trackers.initial import InitialConfig, Prior, TentativeTrack
from trackbench.trackers.late import ProcessedScan


def estimate_of(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """The estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], known: Mask | None) -> Estimate:
    """The estimate with the innovation of its measurement.

    Args:
        estimate: after the measurement.
        update: by it.
        known: ``(...)`` where there was a track before the measurement; None: everywhere.
    """
    return estimate._replace(
        innovation=where_known(known, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_known(known, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_known(known, update.mixture),
    )


def where_known(known: Mask | None, values: Array) -> Array:
    """The values, NaN where nothing is known yet; None: all is known."""
    return values if known is None or np.all(known) else np.where(known, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """``(batch,)`` log density of the measurement under the prediction, ``N(y; 0, S)`` of innovation and covariance.

    NaN where there was no prediction; None where the estimate has no innovation.
    """
    stated: Any = estimate.log_likelihood
    if stated is not None:
        return np.asarray(stated)
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
class InOrder:
    """The part of a tracker that processes scans in the order of their times; its fields are the tracker's."""

    filter: Filter[Any]
    engine: Engine
    initial: InitialConfig
    prior: Prior | None
    sensors: Collection[str] | None
    fallback: FallbackFilter

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return filter_by(self.engine, self.filter)

    def empty(self, valid: Mask) -> TrackState:
        """The state before the first scan, whose measurements are ``valid`` ``(...)``."""
        belief = self.filter.begin(lambda motion: initial.placeholder(motion, valid.shape))
        return TrackState(-np.inf, belief, np.zeros_like(valid))

    def step(self, state: TrackState, scan: Scan, origins: Indices | None = None) -> tuple[TrackState, Estimate]:
        """The state and the estimate after a scan that is not older than the state; origins are not used."""
        elapsed, known, waiting = scan.time - state.time, state.started, state.waiting
        reads = reads_sensor(scan, self.sensors) and bool(np.any(scan.valid))
        step = self._fused_step(state, scan, elapsed) if reads else None
        if step is not None and np.all(known):
            belief = step.update.belief
            estimate = with_innovation(estimate_of(belief, step.cartesian), step.update, None)
            return state._replace(time=scan.time, belief=belief._replace(repaired=None)), estimate
        update: Update[Any] | None = None
        if step is not None:
            update, fallback = step.update, None
            belief = choose(known, update.belief, state.belief)
        else:
            belief, fallback = self._predicted(state, elapsed)
            if self.prior is not None:
                belief, known = self.prior.begin(scan.time, belief, known, self.computed_filter)
            if reads:
                update, fallback = self._updated(belief, fallback, scan, known)
                belief = update.belief
        started = known
        if self.prior is None and reads_sensor(scan, self.initial.sensors or self.sensors) and not np.all(known):
            start = initial.start(self.initial, scan, waiting)
            fresh = start.ready & ~known
            if np.any(fresh):
                belief = choose(fresh, self.filter.begin(start.state_of), belief)
                fallback = self.fallback.begun(fallback, fresh, start.state_of)
            started, waiting = known | fresh, start.waiting
        if fallback is not None:
            belief, fallback = self.fallback.returned(fallback, belief)
        after = TrackState(scan.time, belief, started, waiting, fallback)
        estimate = self.estimate(after)
        if update is not None:
            estimate = with_innovation(estimate, update, known)
        return after._replace(belief=belief._replace(repaired=None)), estimate

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
            estimate = estimate._replace(mode_probabilities=where_known(started, estimate.mode_probabilities))
        return estimate if estimate.repaired is None else estimate._replace(repaired=estimate.repaired & started)

    def _fused_step(self, state: TrackState, scan: Scan, elapsed: float) -> Step[Any] | None:
        """Prediction and update at once; None where a track may start or is, or would be, in the fallback."""
        if state.fallback is not None:
            return None
        if not np.all(state.started) and (self.prior is not None or not np.any(state.started)):
            return None
        step = self.computed_filter.step(state.belief, elapsed, scan, self.fallback.guard)
        refused = step.refused is not None and np.any(state.started & step.refused)
        return None if refused else step

    def _predicted(self, state: TrackState, elapsed: float) -> tuple[AnyBelief, CartesianFallback | None]:
        belief, started = state.belief, state.started
        if np.any(started):
            belief = self.computed_filter.predict(belief, elapsed)
            if not np.all(started):
                # A placeholder stays as it is, so that its covariance does not grow without bound.
                belief = choose(started, belief, state.belief)
        return belief, self.fallback.predicted(state.fallback, elapsed, belief, started)

    def _updated(
        self, belief: AnyBelief, fallback: CartesianFallback | None, scan: Scan, started: Mask
    ) -> tuple[Update[Any], CartesianFallback | None]:
        if fallback is None:
            # For placeholders alone nothing is compiled.
            return (self.computed_filter if np.any(started) else self.filter).update(belief, scan), None
        return self.fallback.updated(fallback, scan, lambda part: self.computed_filter.update(belief, part))


def reads_sensor(scan: Scan, sensors: Collection[str] | None) -> bool:
    """Whether the scan is of one of the named sensors; None names all."""
    return sensors is None or scan.sensor in sensors

"""A tracker that runs one of the built-in filters, with late scans, and its smoother."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, pairwise
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.base.units import difference
from trackbench.engine.choice import Engine, used
from trackbench.engine.equations import EngineUsed
from trackbench.filters import Belief, Filter, SingleModelFilter, Update, bare, choose
from trackbench.filters.base import correct, guarded
from trackbench.models.motion import Kinematics, MotionModel, process_noise
from trackbench.trackers import initial
from trackbench.trackers.cartesian_fallback import FallbackFilter, has_yaw
from trackbench.trackers.config import AdvanceAt, AssumedSensors
from trackbench.trackers.in_order import InOrder, TrackState, total_log_likelihood, with_innovation
from trackbench.trackers.initial import InitialConfig, Prior
from trackbench.trackers.late import LateMethod, ProcessedScan, appended, inserted, position, replayed, up_to_date


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


def after_replay(tracker: InOrder, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
    """The state with a late scan at this index of its history, and the present estimate with that scan's innovation."""
    again = replayed(tracker.step, state.history, number, scan)
    late = again.late
    gained = total_log_likelihood(again.history[number:]) - total_log_likelihood(state.history[number:])
    return again.state._replace(history=again.history), again.latest._replace(
        innovation=late.innovation,
        innovation_covariance=late.innovation_covariance,
        whitened_innovation=late.whitened_innovation,
        # Of the late scan given all that were processed before. Zero: no track was there for any of them.
        log_likelihood=np.where(gained == 0.0, np.nan, gained),
    )


def after_retrodiction(tracker: InOrder, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
    """The present state and estimate corrected by a late scan, where a track has gone on since before it."""
    history = up_to_date(tracker.step, state.history, number)
    before = history[number].before
    known = before.started & state.started
    part = scan._replace(valid=known & scan.valid)
    if before.fallback is not None or state.fallback is not None or not np.any(part.valid):
        return state._replace(history=history), tracker.estimate(state)
    assert isinstance(tracker.filter, SingleModelFilter)
    assert isinstance(before.belief, Belief)
    assert isinstance(state.belief, Belief)
    times = tuple(processed.scan.time for processed in history[number:])
    update = retrodicted(tracker.filter, Retrodiction(before.belief, before.time, state.belief, times), part)
    after = state._replace(belief=update.belief)
    estimate = with_innovation(tracker.estimate(after), update, known)
    history = inserted(history, number, part)
    return after._replace(belief=update.belief._replace(repaired=None), history=history), estimate


class Retrodiction(NamedTuple):
    """What a filter believed before a late measurement was taken, and believes now."""

    before: Belief
    """After the latest scan that was taken before it."""
    time: float
    """Of that scan, s."""
    now: Belief
    times: tuple[float, ...]
    """Of all scans that were taken since the late one; the last is that of ``now``, s."""


def retrodicted(filter: SingleModelFilter, known: Retrodiction, scan: Scan) -> Update[Belief]:
    """The present belief with a late measurement, without taking later ones in again.

    All measurements since ``known.before`` count as one equivalent measurement at the present, which the two beliefs
    tell; with it the state and the process noise go back to the late measurement's time. With one measurement in
    between and a linear model this is the optimal algorithm A1, with more Al1, which is nearly so. The process noise is
    that of the steps between the measurements. A nonlinear model is linearised at the present mean, and its transition
    taken over a negative time.

    Source: Bar-Shalom (2002), "Update with out-of-sequence measurements in tracking: exact solution", equations 18 to
    35; Bar-Shalom, Chen and Mallick (2004), "One-step solution for the multistep out-of-sequence-measurement problem in
    tracking", section III.
    """
    motion, now = filter.motion, known.now
    back = known.times[-1] - scan.time
    ahead = known.before
    for start, end in pairwise((known.time, *known.times)):
        ahead = filter.predict(Belief(ahead.mean, ahead.covariance), end - start)
    gained = difference(now.mean, ahead.mean, motion.angular)
    inverse = _inverse(ahead.covariance)
    # What the equivalent measurement says: its information, and with it its innovation.
    information = linalg.matmul(linalg.matmul(inverse, ahead.covariance - now.covariance), inverse)
    noise = _noise(motion, now, (scan.time, *known.times))
    pushed = linalg.apply(linalg.matmul(noise, inverse), gained)
    noise_covariance = noise - linalg.quadratic(noise, information)
    shared = noise - linalg.matmul(linalg.matmul(ahead.covariance, information), noise)
    f = np.broadcast_to(linalg.expand(motion.jacobian(now.mean, -back), now.covariance), now.covariance.shape)
    with_past = linalg.matmul_transposed(now.covariance - shared, f)
    spread = now.covariance + noise_covariance - shared - np.swapaxes(shared, 0, 1)
    past = guarded(Belief(motion.transition(now.mean - pushed, -back), linalg.symmetrise(linalg.quadratic(f, spread))))
    expected, measured = filter.predict_measurement(past, scan), filter.measured(scan)
    # Of the present state: the measurement's cross covariance with the past one, carried there.
    slope = linalg.matmul(expected.cross, _inverse(past.covariance))
    cross = linalg.matmul_transposed(slope, with_past)
    innovation = difference(measured.value, expected.mean, measured.angular)
    s = expected.covariance + linalg.expand(measured.noise, expected.covariance)
    update = correct(now._replace(points=None, factor=None), innovation, s, cross, scan.valid, motion.angular)
    return update._replace(belief=guarded(update.belief))


def _noise(motion: MotionModel, now: Belief, times: tuple[float, ...]) -> Array:
    """``(n, n, ...)`` covariance of the process noise between these times, s, in the state at the last of them."""
    noise = np.zeros_like(now.covariance)
    for start, end in pairwise(times):
        mean = motion.transition(now.mean, start - times[-1])
        added = process_noise(motion, mean, end - start)
        f = linalg.expand(motion.jacobian(mean, end - start), noise)
        noise = linalg.quadratic(np.broadcast_to(f, noise.shape), noise) + linalg.expand(added, noise)
    return noise


def _inverse(p: Array) -> Array:
    """The inverse of a covariance ``(n, n, ...)``."""
    identity = np.broadcast_to(linalg.expand(np.eye(len(p)), p), p.shape)
    return linalg.gram(linalg.ensure_definite(p).factor.whiten(identity))


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

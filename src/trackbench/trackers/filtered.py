"""A tracker that runs one of the built-in filters."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Indices, Mask, Scan
from trackbench.engine.choice import Engine, compute_by, filter_by, used
from trackbench.engine.used import EngineUsed
from trackbench.filters import (
    AnyBelief,
    Belief,
    Doubt,
    Filter,
    MultiModelBelief,
    SingleModelFilter,
    Step,
    Update,
    choose,
)
from trackbench.models.motion import Kinematics, MotionModel
from trackbench.trackers import course, initial
from trackbench.trackers.assumed import AssumedSensors
from trackbench.trackers.base import Prior
from trackbench.trackers.config import AdvanceAt
from trackbench.trackers.course import CourseLost, WithoutCourse
from trackbench.trackers.initial import TentativeTrack
from trackbench.trackers.initial_config import InitialConfig
from trackbench.trackers.innovations import total_log_likelihood, where_known, with_innovation
from trackbench.trackers.late import LateMethod, Taken, inserted, kept, position, replayed, up_to_date
from trackbench.trackers.retrodiction import Retrodiction, retrodicted


class TrackState(NamedTuple):
    """What the tracker knows after a scan."""

    time: float
    """Of the last scan at which the state advanced, s."""
    belief: AnyBelief
    started: Mask
    """``(...)`` where there is a track; elsewhere the belief is a placeholder."""
    waiting: TentativeTrack | None = None
    lost: WithoutCourse | None = None
    """The tracks whose course is not known; their belief is then made of position and velocity."""
    history: tuple[Taken[TrackState, Estimate], ...] = ()
    """The latest scans that were taken in, where late ones may come."""


@dataclass(frozen=True)
class FilterTracker:
    """Runs a filter on a batch of objects: starts each track, predicts to each scan, updates where it is valid.

    At a scan of a sensor that it does not read it is only asked for its estimate: the answer is a prediction over the
    whole time since its last own scan, and is not kept. So no estimate depends on a sensor that is not read.
    """

    filter: Filter[Any]
    initial: InitialConfig
    prior: Prior | None = None
    """Set by the bench where ``initial`` says that tracks start from the truth."""
    assumed: AssumedSensors = field(default_factory=AssumedSensors)
    sensors: Collection[str] | None = None
    """Names of the sensors whose measurements it takes in; None: all that it is given."""
    advance_at: AdvanceAt = "own_scans"
    late: LateMethod = "replay"
    """What becomes of a scan that is older than the state."""
    lag_s: float = 1.0
    """How far back a late scan may reach, s."""
    without_course: bool = True
    """Whether a track whose yaw is no longer known goes on with position and velocity, if a batch starts it."""
    engine: Engine = "numpy"

    batched: ClassVar = True

    def step(self, state: TrackState | None, scan: Scan) -> tuple[TrackState, Estimate]:
        """Predict to the scan's time, and take its measurements in if it is of a sensor that the tracker reads.

        A scan that is older than the state is dealt with as ``late`` says; the estimate is then that at the state's
        time.
        """
        scan = self.assumed.read(scan)
        if state is None:
            state = self._nothing_yet(scan)
        if scan.asked or not self.advances(scan.sensor):
            return state, self._asked(state, scan.time)
        if self.late == "as_new":
            scan = scan._replace(time=scan.arrival_time)
        number = position(state.history, scan)
        if scan.time < state.time or (number is not None and self.late == "replay"):
            return self._out_of_sequence(state, scan, number)
        before = state._replace(history=()) if state.history else state
        after, estimate = self._in_sequence(before, scan)
        if self.late not in ("replay", "retrodiction") or self.lag_s == 0.0:
            return after, estimate
        taken = Taken(before, scan, said=estimate)
        return after._replace(history=kept(self._in_sequence, state.history, taken, self.lag_s)), estimate

    def _asked(self, state: TrackState, time: float) -> Estimate:
        return self.estimate(self.predicted(state, time))

    def _nothing_yet(self, scan: Scan) -> TrackState:
        return TrackState(-np.inf, self._placeholder(scan.valid), np.zeros_like(scan.valid))

    def _out_of_sequence(self, state: TrackState, scan: Scan, number: int | None) -> tuple[TrackState, Estimate]:
        if number is None:
            return state, self._asked(state, state.time)
        if self.late == "retrodiction":
            return self._retrodicted(state, scan, number)
        again = replayed(self._in_sequence, state.history, number, scan)
        said = again.late
        gained = total_log_likelihood(again.history[number:]) - total_log_likelihood(state.history[number:])
        return again.state._replace(history=again.history), again.latest._replace(
            innovation=said.innovation,
            innovation_covariance=said.innovation_covariance,
            whitened_innovation=said.whitened_innovation,
            # Of the late scan given all that were taken in before. Zero: no track was there for any of them.
            log_likelihood=np.where(gained == 0.0, np.nan, gained),
        )

    def _retrodicted(self, state: TrackState, scan: Scan, number: int) -> tuple[TrackState, Estimate]:
        """The present state with a late scan, where a track has gone on since before it."""
        history = up_to_date(self._in_sequence, state.history, number)
        before = history[number].before
        known = before.started & state.started
        taken = scan._replace(valid=known & scan.valid)
        if before.lost is not None or state.lost is not None or not np.any(taken.valid):
            return state._replace(history=history), self._asked(state, state.time)
        assert isinstance(self.filter, SingleModelFilter)
        assert isinstance(before.belief, Belief)
        assert isinstance(state.belief, Belief)
        times = tuple(one.scan.time for one in history[number:])
        said = retrodicted(self.filter, Retrodiction(before.belief, before.time, state.belief, times), taken)
        after = state._replace(belief=said.belief)
        estimate = with_innovation(self.estimate(after), said, known)
        history = inserted(history, number, taken)
        return after._replace(belief=said.belief._replace(repaired=None), history=history), estimate

    def _in_sequence(
        self, state: TrackState, scan: Scan, origins: Indices | None = None
    ) -> tuple[TrackState, Estimate]:
        elapsed = scan.time - state.time
        all_started = bool(np.all(state.started))
        stepped = self._stepped(state, scan, elapsed, all_started)
        if stepped is not None and all_started:
            return self._gone_on(state, scan, stepped)
        known, waiting, said = state.started, state.waiting, None if stepped is None else stepped.update
        if said is not None:
            belief, started, lost = choose(known, said.belief, state.belief), known, None
        else:
            belief = self._predict(state, elapsed)
            lost = self._without_course(state, belief, elapsed)
            belief, started = self._given(self.prior, scan.time, belief, known)
            known = started
            if np.any(scan.valid) and _named(scan, self.sensors):
                said, lost = self._updated(belief, lost, scan, started)
                belief = said.belief
        if self.prior is None and _named(scan, self.initial.sensors or self.sensors) and not np.all(started):
            begin = initial.start(self.initial, scan, waiting, self.filter.motions, ~started, compute_by(self.engine))
            fresh = begin.ready & ~started
            if np.any(fresh):
                belief = choose(fresh, self.filter.begin(begin.state_of), belief)
            if begin.without_course is not None and np.any(begin.without_course):
                lost = course.joined(lost, begin.without_course, begin.state_of(self._by_velocity.motions[0]))
            started, waiting = started | begin.ready, begin.waiting
        if lost is not None:
            belief = choose(lost.where, self._from_velocity(lost.belief), belief)
            still = lost.where & ~course.course_known(Gaussian(lost.belief.mean, lost.belief.covariance))
            lost = lost._replace(where=still) if np.any(still) else None
        after = TrackState(scan.time, belief, started, waiting, lost)
        estimate = self.estimate(after)
        if said is not None:
            estimate = with_innovation(estimate, said, known)
        return after._replace(belief=belief._replace(repaired=None)), estimate

    def _stepped(self, state: TrackState, scan: Scan, elapsed: float, all_started: bool) -> Step[Any] | None:
        """The next step, where nothing but a prediction and an update is to be done of the tracks that there are."""
        reads = _named(scan, self.sensors) and bool(np.any(scan.valid))
        if not reads or state.lost is not None:
            return None
        if not all_started and (self.prior is not None or not np.any(state.started)):
            return None
        stepped = self.computed_filter.step(state.belief, elapsed, scan, self._doubt)
        doubtful = stepped.doubtful is not None and np.any(state.started & stepped.doubtful)
        return None if doubtful else stepped

    def _gone_on(self, state: TrackState, scan: Scan, stepped: Step[Any]) -> tuple[TrackState, Estimate]:
        said = stepped.update
        estimate = with_innovation(_estimate(said.belief, stepped.cartesian), said, None)
        return state._replace(time=scan.time, belief=said.belief._replace(repaired=None)), estimate

    @cached_property
    def _doubt(self) -> Doubt | None:
        """Of a track that may lose its course a step is not made where it does."""
        return self._course_lost if self._may_lose_course else None

    @cached_property
    def _course_lost(self) -> CourseLost:
        return CourseLost(tuple(motion.components for motion in self.filter.motions))

    def _without_course(self, state: TrackState, belief: AnyBelief, elapsed: float) -> WithoutCourse | None:
        """The tracks whose course is not known, predicted; ``belief`` is what was predicted of all."""
        lost = state.lost
        if lost is not None and elapsed > 0.0:
            lost = lost._replace(belief=self._by_velocity.predict(lost.belief, elapsed))
        if not self._may_lose_course or not np.any(state.started):
            return lost
        fresh = state.started & self._course_lost(belief)
        if lost is not None:
            fresh = fresh & ~lost.where
        if not np.any(fresh):
            return lost
        return course.joined(lost, fresh, course.cartesian_moments(self.filter.motions, belief))

    def _updated(
        self, belief: AnyBelief, lost: WithoutCourse | None, scan: Scan, started: Mask
    ) -> tuple[Update[Any], WithoutCourse | None]:
        if lost is None:
            # For placeholders alone nothing is compiled.
            return (self.computed_filter if np.any(started) else self.filter).update(belief, scan), None
        said = self.computed_filter.update(belief, scan._replace(valid=scan.valid & ~lost.where))
        aside = self._by_velocity.update(lost.belief, scan._replace(valid=scan.valid & lost.where))
        both = said._replace(
            innovation=np.where(lost.where, aside.innovation, said.innovation),
            innovation_covariance=np.where(lost.where, aside.innovation_covariance, said.innovation_covariance),
            whitened_innovation=np.where(lost.where, aside.whitened_innovation, said.whitened_innovation),
            mixture=None if said.mixture is None else np.where(lost.where, aside.log_likelihood, said.mixture),
        )
        return both, lost._replace(belief=aside.belief)

    @cached_property
    def _by_velocity(self) -> Filter[Belief]:
        """What tracks go on with whose course is not known."""
        return filter_by(self.engine, course.by_velocity(self.filter, self.initial.acceleration_sigma_mps2))

    @cached_property
    def _may_lose_course(self) -> bool:
        sound = self.prior is None and self.initial.source == "batch"
        return sound and self.without_course and course.has_yaw(self.filter.motions)

    def _from_velocity(self, belief: Belief) -> AnyBelief:
        cartesian, sigmas = Gaussian(belief.mean, belief.covariance), initial.sigmas(self.initial)
        made: AnyBelief = self.filter.begin(lambda motion: motion.from_cartesian(cartesian, sigmas))
        return made

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

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        return used(self.computed_filter)

    @cached_property
    def computed_filter(self) -> Filter[Any]:
        """The filter as the engine computes it."""
        return filter_by(self.engine, self.filter)

    def with_prior(self, time: Array, motion: Kinematics, normal: Array) -> FilterTracker:
        """This tracker, its tracks starting at the given times from the given motion with a drawn error.

        Args:
            time: ``(...)`` s.
            motion: the true motion at that time, each ``(...)``.
            normal: ``(6 or more, ...)`` standard normal numbers, of which the first ``n`` are used.
        """
        begun = self.filter.begin(lambda model: initial.from_truth(model, self.initial, motion, normal))
        return replace(self, prior=Prior(time, begun))

    def predicted(self, state: TrackState, time: float) -> TrackState:
        """What is believed at a time at which the state does not advance."""
        elapsed = time - state.time
        if elapsed <= 0.0:
            # A prediction over no time would draw sigma points anew, and change the last digits.
            return state
        belief = self._predict(state, elapsed)
        return state._replace(time=time, belief=belief, lost=self._without_course(state, belief, elapsed))

    def _placeholder(self, valid: Mask) -> AnyBelief:
        def anything(motion: MotionModel) -> Gaussian:
            mean = np.ones((len(motion.components), *np.shape(valid)))
            return Gaussian(mean, np.zeros((len(mean), *mean.shape)) + linalg.expand(np.eye(len(mean)), mean[None]))

        placeholder: AnyBelief = self.filter.begin(anything)
        return placeholder

    def _predict(self, state: TrackState, elapsed: float) -> AnyBelief:
        if not np.any(state.started):
            return state.belief
        belief: AnyBelief = self.computed_filter.predict(state.belief, elapsed)
        if np.all(state.started):
            return belief
        # A placeholder stays what it is, so that its covariance does not grow without bound.
        return choose(state.started, belief, state.belief)

    def _given(self, prior: Prior | None, time: float, belief: AnyBelief, started: Mask) -> tuple[AnyBelief, Mask]:
        """The belief with the tracks whose time has come started from the truth, ready for their first update."""
        if prior is None:
            return belief, started
        fresh = (time >= prior.time) & ~started
        if not np.any(fresh):
            return belief, started
        # A prediction over no time gives the sigma points that an update may reuse.
        return choose(fresh, self.computed_filter.predict(prior.belief, 0.0), belief), started | fresh

    def estimate(self, state: TrackState) -> Estimate:
        """What is said of the objects, also of those whose tracks have not started."""
        belief, started, waiting, lost = state.belief, state.started, state.waiting, state.lost
        mean, covariance = self.computed_filter.cartesian(belief)
        if lost is not None:
            mean = np.where(lost.where, lost.belief.mean, mean)
            covariance = np.where(lost.where, lost.belief.covariance, covariance)
        if not np.all(started):
            before: Gaussian | tuple[float, float] = (np.nan, np.nan)
            if waiting is not None and self.initial.waiting == "at_rest":
                before = initial.at_rest(waiting, self.initial)
            mean = np.where(started, mean, before[0])
            covariance = np.where(started, covariance, before[1])
        found = _estimate(belief, Gaussian(mean, covariance))
        if found.mode_probabilities is not None:
            found = found._replace(mode_probabilities=where_known(started, found.mode_probabilities))
        return found if found.repaired is None else found._replace(repaired=found.repaired & started)


def _estimate(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def _named(scan: Scan, sensors: Collection[str] | None) -> bool:
    return sensors is None or scan.sensor in sensors

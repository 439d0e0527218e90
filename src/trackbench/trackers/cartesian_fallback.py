"""Position and velocity in place of a state whose course is unknown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Mask, Scan
from trackbench.engine.choice import Engine, filter_by
from trackbench.filters import (
    AnyBelief,
    Belief,
    Filter,
    InteractingMultipleModel,
    MultiModelBelief,
    SingleModelFilter,
    StepGuard,
    Update,
    choose,
)
from trackbench.filters.imm import moment_matched
from trackbench.models.motion import ConstantVelocity, InitialSigmas, MotionModel
from trackbench.models.motion.base import YAW

#: Standard deviation of a yaw above which a state with it is no longer taken to be Gaussian, rad.
COURSE_LOST = 0.5
#: Standard deviation of the course below which it is, rad.
COURSE_KNOWN = 0.1
#: Share of the speed below which the standard deviation along the course must be as well: a speed of either sign has no
#: course.
SPEED_KNOWN = 0.2


class CartesianFallback(NamedTuple):
    """The tracks whose course is unknown."""

    where: Mask
    """``(...)`` which tracks these are."""
    belief: Belief
    """``(4, ...)`` px, py, vx, vy; elsewhere a placeholder."""


def added(fallback: CartesianFallback | None, where: Mask, cartesian: Gaussian) -> CartesianFallback:
    """The fallback with further tracks.

    Args:
        fallback: the tracks in it so far.
        where: ``(...)`` the further ones.
        cartesian: ``(4, ...)`` their px, py, vx, vy.
    """
    belief = Belief(*cartesian)
    if fallback is None:
        return CartesianFallback(where, belief)
    both = choose(where, belief, fallback.belief)
    assert isinstance(both, Belief)
    return CartesianFallback(fallback.where | where, both)


def course_known(belief: Gaussian) -> Mask:
    """``(...)`` whether the velocity of px, py, vx, vy tells the course, and is far enough from its reverse."""
    vx, vy = belief.mean[2:]
    p = belief.covariance[2:, 2:]
    square = vx * vx + vy * vy
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (vy * vy * p[0, 0] - 2.0 * vx * vy * p[0, 1] + vx * vx * p[1, 1]) / square
        along = p[0, 0] + p[1, 1] - across
        return np.asarray((across < COURSE_KNOWN**2 * square) & (along < SPEED_KNOWN**2 * square))


@dataclass(frozen=True)
class CourseLost:
    """Tells where a belief has lost the course: where modes of more than half the probability are too uncertain."""

    components: tuple[tuple[str, ...], ...]
    """Of the state of each motion model."""

    def __call__(self, belief: AnyBelief) -> Mask:
        lost: Array = np.zeros(belief[0].shape[1:])
        for names, mode, weight in zip(self.components, *_modes(belief), strict=True):
            for name in set(YAW) & set(names):
                i = names.index(name)
                lost = lost + weight * (mode.covariance[i, i] >= COURSE_LOST**2)
        return lost > 0.5


@dataclass(frozen=True)
class FallbackFilter:
    """Runs the tracks whose course is unknown with a filter of the tracker's kind on px, py, vx, vy."""

    filter: Filter[Any]
    """The tracker's."""
    engine: Engine
    sigmas: InitialSigmas
    """Assumed of the components that position and velocity leave open; the acceleration drives the fallback."""
    at_start: bool
    """Whether a track may start so."""
    later: bool
    """Whether one falls back that loses its course later."""

    @cached_property
    def guard(self) -> StepGuard | None:
        """Refuses the fused step for tracks whose course has become unknown."""
        return CourseLost(tuple(motion.components for motion in self.filter.motions)) if self.later else None

    @cached_property
    def _cartesian(self) -> Filter[Belief]:
        single = self.filter.filters[0] if isinstance(self.filter, InteractingMultipleModel) else self.filter
        assert isinstance(single, SingleModelFilter)
        return filter_by(
            self.engine, replace(single, motion=ConstantVelocity(acceleration_sigma_mps2=self.sigmas.acceleration))
        )

    def begun(
        self, fallback: CartesianFallback | None, fresh: Mask, state_of: Callable[[MotionModel], Gaussian]
    ) -> CartesianFallback | None:
        """The fallback with the fresh tracks ``(...)`` whose course is unknown where they start."""
        if not self.at_start:
            return fallback
        cartesian = state_of(self._cartesian.motions[0])
        fresh = fresh & ~course_known(cartesian)
        return added(fallback, fresh, cartesian) if np.any(fresh) else fallback

    def predicted(
        self, fallback: CartesianFallback | None, elapsed: float, belief: AnyBelief, started: Mask
    ) -> CartesianFallback | None:
        """The fallback ``elapsed`` seconds later, with the tracks that lose their course by then.

        Args:
            fallback: the one before.
            elapsed: s.
            belief: the predicted belief of all tracks.
            started: ``(...)`` where there is a track.
        """
        if fallback is not None and elapsed > 0.0:
            fallback = fallback._replace(belief=self._cartesian.predict(fallback.belief, elapsed))
        if self.guard is None or not np.any(started):
            return fallback
        lost = started & self.guard(belief)
        if fallback is not None:
            lost = lost & ~fallback.where
        return added(fallback, lost, _cartesian_moments(self.filter.motions, belief)) if np.any(lost) else fallback

    def updated(
        self, fallback: CartesianFallback, scan: Scan, update: Callable[[Scan], Update[Any]]
    ) -> tuple[Update[Any], CartesianFallback]:
        """Update all tracks with a scan: ``update`` those whose course is known, this filter the others."""
        others = update(scan._replace(valid=scan.valid & ~fallback.where))
        own = self._cartesian.update(fallback.belief, scan._replace(valid=scan.valid & fallback.where))
        here = fallback.where
        both = others._replace(
            innovation=np.where(here, own.innovation, others.innovation),
            innovation_covariance=np.where(here, own.innovation_covariance, others.innovation_covariance),
            whitened_innovation=np.where(here, own.whitened_innovation, others.whitened_innovation),
            mixture=None if others.mixture is None else np.where(here, own.log_likelihood, others.mixture),
        )
        return both, fallback._replace(belief=own.belief)

    def returned(self, fallback: CartesianFallback, belief: AnyBelief) -> tuple[AnyBelief, CartesianFallback | None]:
        """The belief of all tracks in their own state, and the fallback without those whose course is known again."""
        still = fallback.where & ~course_known(Gaussian(fallback.belief.mean, fallback.belief.covariance))
        left = fallback._replace(where=still) if np.any(still) else None
        return self._in_own_state(fallback, belief), left

    def smoothed(
        self, fallback: CartesianFallback, elapsed: float, later: Gaussian, belief: AnyBelief
    ) -> tuple[AnyBelief, CartesianFallback]:
        """The belief of all tracks in their own state, and the fallback, smoothed.

        Args:
            fallback: of the filter.
            elapsed: s, more than zero.
            later: ``(4, ...)`` px, py, vx, vy that much later, smoothed.
            belief: of all tracks, with the smoothed ones of those whose course is known.
        """
        after = choose(fallback.where, Belief(*later), fallback.belief)
        assert isinstance(after, Belief)
        fallback = fallback._replace(belief=self._cartesian.smooth(fallback.belief, after, elapsed))
        return self._in_own_state(fallback, belief), fallback

    def _in_own_state(self, fallback: CartesianFallback, belief: AnyBelief) -> AnyBelief:
        cartesian = Gaussian(fallback.belief.mean, fallback.belief.covariance)
        own = self.filter.begin(lambda motion: motion.from_cartesian(cartesian, self.sigmas))
        return choose(fallback.where, own, belief)


def _cartesian_moments(motions: Sequence[MotionModel], belief: AnyBelief) -> Gaussian:
    """Mean and covariance of px, py, vx, vy, however little is known of the yaw."""
    modes, weights = _modes(belief)
    parts = [
        motion.cartesian_moments(Gaussian(mode.mean, mode.covariance))
        for motion, mode in zip(motions, modes, strict=True)
    ]
    return moment_matched(weights, parts, ())


def _modes(belief: AnyBelief) -> tuple[tuple[Belief, ...], Array]:
    if isinstance(belief, MultiModelBelief):
        return belief.modes, belief.probability
    return (belief,), np.ones((1, *belief.mean.shape[1:]))

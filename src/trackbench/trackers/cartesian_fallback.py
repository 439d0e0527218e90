"""Replacement of a track's state by position and velocity while its course is unknown."""

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

#: Standard deviation of the yaw above which a state with a yaw no longer counts as Gaussian, rad.
COURSE_LOST = 0.5
#: Standard deviation of the course below which the course counts as known, rad.
COURSE_KNOWN = 0.1
#: Largest standard deviation along a known course, as a share of the speed: a speed of uncertain sign has no course.
SPEED_KNOWN = 0.2


class CartesianFallback(NamedTuple):
    """Position and velocity of tracks whose course is unknown, in place of a state with a yaw."""

    where: Mask
    """Mask ``(...)``, True for tracks in the fallback, which are followed by position and velocity alone."""
    belief: Belief
    """Belief of px, py, vx, vy ``(4, ...)``; a placeholder for tracks that are not in the fallback."""


def joined(fallback: CartesianFallback | None, where: Mask, cartesian: Gaussian) -> CartesianFallback:
    """Add tracks to the fallback, in which tracks are followed by position and velocity alone.

    Args:
        fallback: tracks in the fallback so far, if any.
        where: mask ``(...)``, True for the further tracks.
        cartesian: belief of px, py, vx, vy ``(4, ...)`` of the further tracks.
    """
    belief = Belief(*cartesian)
    if fallback is None:
        return CartesianFallback(where, belief)
    beliefs = choose(where, belief, fallback.belief)
    assert isinstance(beliefs, Belief)
    return CartesianFallback(fallback.where | where, beliefs)


def course_known(belief: Gaussian) -> Mask:
    """Return a mask ``(...)`` of velocities certain enough to tell the course from its reverse."""
    vx, vy = belief.mean[2:]
    p = belief.covariance[2:, 2:]
    square = vx * vx + vy * vy
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (vy * vy * p[0, 0] - 2.0 * vx * vy * p[0, 1] + vx * vx * p[1, 1]) / square
        along = p[0, 0] + p[1, 1] - across
        return np.asarray((across < COURSE_KNOWN**2 * square) & (along < SPEED_KNOWN**2 * square))


@dataclass(frozen=True)
class CourseLost:
    """Test that is True for a belief whose yaw is uncertain in modes with more than half of the probability."""

    components: tuple[tuple[str, ...], ...]
    """Names of the state's components, for each motion model."""

    def __call__(self, belief: AnyBelief) -> Mask:
        lost_probability: Array = np.zeros(belief[0].shape[1:])
        for names, mode, weight in zip(self.components, *_modes(belief), strict=True):
            for name in set(YAW) & set(names):
                i = names.index(name)
                lost_probability = lost_probability + weight * (mode.covariance[i, i] >= COURSE_LOST**2)
        return lost_probability > 0.5


@dataclass(frozen=True)
class FallbackFilter:
    """Filter on px, py, vx, vy for tracks whose course is unknown, of the same kind as the tracker's filter."""

    filter: Filter[Any]
    """Filter of the tracker, for tracks whose course is known."""
    engine: Engine
    sigmas: InitialSigmas
    """Standard deviations assumed for other components; that of the acceleration is also this filter's process
    noise."""
    at_start: bool
    """Whether a track is allowed to start in the fallback, as position and velocity alone."""
    later: bool
    """Whether a track whose course becomes unknown after its start enters the fallback."""

    @cached_property
    def guard(self) -> StepGuard | None:
        """Test that refuses the fused step for tracks whose course becomes unknown; None unless ``later``."""
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
        """Return the fallback (tracks by position and velocity; None: empty) with ``fresh`` tracks of unknown course.

        New tracks enter only if ``at_start`` is True.
        """
        if not self.at_start:
            return fallback
        cartesian = state_of(self._cartesian.motions[0])
        fresh = fresh & ~course_known(cartesian)
        return joined(fallback, fresh, cartesian) if np.any(fresh) else fallback

    def predicted(
        self, fallback: CartesianFallback | None, elapsed: float, belief: AnyBelief, started: Mask
    ) -> CartesianFallback | None:
        """Predict the fallback (tracks by position and velocity), and add tracks whose course becomes unknown.

        Args:
            fallback: fallback at the earlier time, if any.
            elapsed: time to predict over, s.
            belief: predicted belief of all tracks.
            started: mask ``(...)``, True for tracks that have started.
        """
        if fallback is not None and elapsed > 0.0:
            fallback = fallback._replace(belief=self._cartesian.predict(fallback.belief, elapsed))
        if self.guard is None or not np.any(started):
            return fallback
        lost = started & self.guard(belief)
        if fallback is not None:
            lost = lost & ~fallback.where
        return joined(fallback, lost, _cartesian_moments(self.filter.motions, belief)) if np.any(lost) else fallback

    def updated(
        self, fallback: CartesianFallback, scan: Scan, update: Callable[[Scan], Update[Any]]
    ) -> tuple[Update[Any], CartesianFallback]:
        """Update tracks whose course is known by ``update``, and the others by the filter on px, py, vx, vy."""
        known = update(scan._replace(valid=scan.valid & ~fallback.where))
        unknown = self._cartesian.update(fallback.belief, scan._replace(valid=scan.valid & fallback.where))
        is_fallback = fallback.where
        united = known._replace(
            innovation=np.where(is_fallback, unknown.innovation, known.innovation),
            innovation_covariance=np.where(is_fallback, unknown.innovation_covariance, known.innovation_covariance),
            whitened_innovation=np.where(is_fallback, unknown.whitened_innovation, known.whitened_innovation),
            mixture=None if known.mixture is None else np.where(is_fallback, unknown.log_likelihood, known.mixture),
        )
        return united, fallback._replace(belief=unknown.belief)

    def returned(self, fallback: CartesianFallback, belief: AnyBelief) -> tuple[AnyBelief, CartesianFallback | None]:
        """Return all beliefs in the tracker's state, and the fallback without tracks whose course is known again.

        The fallback has the tracks followed by position and velocity alone; None if no track is left in it.
        """
        is_unknown = fallback.where & ~course_known(Gaussian(fallback.belief.mean, fallback.belief.covariance))
        rest = fallback._replace(where=is_unknown) if np.any(is_unknown) else None
        return self._in_own_state(fallback, belief), rest

    def smoothed(
        self, fallback: CartesianFallback, elapsed: float, later: Gaussian, belief: AnyBelief
    ) -> tuple[AnyBelief, CartesianFallback]:
        """Return the smoothed beliefs of all tracks, in the tracker's state, and the smoothed fallback.

        Args:
            fallback: fallback of the filter.
            elapsed: time to the later estimate, s, more than zero.
            later: ``(4, ...)`` smoothed belief of px, py, vx, vy at the later time.
            belief: beliefs of all tracks; smoothed already for tracks outside the fallback.

        """
        after = choose(fallback.where, Belief(*later), fallback.belief)
        assert isinstance(after, Belief)
        fallback = fallback._replace(belief=self._cartesian.smooth(fallback.belief, after, elapsed))
        return self._in_own_state(fallback, belief), fallback

    def _in_own_state(self, fallback: CartesianFallback, belief: AnyBelief) -> AnyBelief:
        cartesian = Gaussian(fallback.belief.mean, fallback.belief.covariance)
        belief_of_fallback = self.filter.begin(lambda motion: motion.from_cartesian(cartesian, self.sigmas))
        return choose(fallback.where, belief_of_fallback, belief)


def _cartesian_moments(motions: Sequence[MotionModel], belief: AnyBelief) -> Gaussian:
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

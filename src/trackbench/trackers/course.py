"""Tracks of a state with a yaw while the yaw is not known: they go on with position and velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Mask
from trackbench.filters import (
    AnyBelief,
    Belief,
    Filter,
    InteractingMultipleModel,
    MultiModelBelief,
    SingleModelFilter,
    choose,
)
from trackbench.filters.mixing import moment_matched
from trackbench.models.motion import ConstantVelocity, MotionModel
from trackbench.models.motion.base import YAW

#: Standard deviation of a yaw above which a state with it is no longer taken to be Gaussian, rad.
COURSE_LOST = 0.5
#: Standard deviation of the course below which it is, rad.
COURSE_KNOWN = 0.1


class WithoutCourse(NamedTuple):
    """The tracks whose course is not known."""

    where: Mask
    """``(...)``"""
    belief: Belief
    """``(4, ...)`` px, py, vx, vy; elsewhere a placeholder."""


def joined(lost: WithoutCourse | None, where: Mask, belief: Gaussian) -> WithoutCourse:
    """The tracks whose course is not known, and further ones."""
    added = Belief(*belief)
    if lost is None:
        return WithoutCourse(where, added)
    both = choose(where, added, lost.belief)
    assert isinstance(both, Belief)
    return WithoutCourse(lost.where | where, both)


def has_yaw(motions: Sequence[MotionModel]) -> bool:
    """Whether the state of any model has a yaw."""
    return any(set(YAW) & set(motion.components) for motion in motions)


@dataclass(frozen=True)
class CourseLost:
    """Says where a state with a yaw can no longer be believed to be Gaussian; of modes, where most of them are so."""

    components: tuple[tuple[str, ...], ...]
    """Of the state of each motion model."""

    def __call__(self, belief: AnyBelief) -> Mask:
        lost: Array = np.zeros(belief[0].shape[1:])
        for names, mode, weight in zip(self.components, *_modes(belief), strict=True):
            for name in set(YAW) & set(names):
                i = names.index(name)
                lost = lost + weight * (mode.covariance[i, i] >= COURSE_LOST**2)
        return lost > 0.5


def course_known(belief: Gaussian) -> Mask:
    """``(...)`` whether the velocity of px, py, vx, vy tells the course."""
    vx, vy = belief.mean[2:]
    p = belief.covariance[2:, 2:]
    square = vx * vx + vy * vy
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (vy * vy * p[0, 0] - 2.0 * vx * vy * p[0, 1] + vx * vx * p[1, 1]) / square
        return np.asarray(across < COURSE_KNOWN**2 * square)


def cartesian_moments(motions: Sequence[MotionModel], belief: AnyBelief) -> Gaussian:
    """Mean and covariance of px, py, vx, vy, however little is known of the yaw."""
    modes, weights = _modes(belief)
    parts = [
        motion.cartesian_moments(Gaussian(mode.mean, mode.covariance))
        for motion, mode in zip(motions, modes, strict=True)
    ]
    return moment_matched(weights, parts, ())


def by_velocity(filter: Filter[Any], acceleration_sigma: float) -> SingleModelFilter:
    """A filter of the same kind for px, py, vx, vy under white acceleration, m/s^2."""
    single = filter.filters[0] if isinstance(filter, InteractingMultipleModel) else filter
    assert isinstance(single, SingleModelFilter)
    return replace(single, motion=ConstantVelocity(acceleration_sigma_mps2=acceleration_sigma))


def _modes(belief: AnyBelief) -> tuple[tuple[Belief, ...], Array]:
    """The modes with the probability of each."""
    if isinstance(belief, MultiModelBelief):
        return belief.modes, belief.probability
    return (belief,), np.ones((1, *belief.mean.shape[1:]))

"""Tracks whose state has a yaw, where the yaw is no longer known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench import linalg
from trackbench.filters import AnyBelief, Belief, MultiModelBelief
from trackbench.models.motion import MotionModel
from trackbench.models.motion.base import POSITION, YAW
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Mask, Scan

#: Standard deviation of a yaw above which a state with it is no longer taken to be Gaussian, rad.
COURSE_LOST = 0.5


def has_yaw(motions: Sequence[MotionModel]) -> bool:
    """Whether the state of any model has a yaw."""
    return any(set(YAW) & set(motion.components) for motion in motions)


def course_known(motions: Sequence[MotionModel], belief: AnyBelief) -> Mask:
    """``(...)`` whether a state with a yaw can still be believed to be Gaussian."""
    known: Mask = np.ones(belief[0].shape[1:], dtype=bool)
    for motion, mode in zip(motions, _modes(belief), strict=True):
        for name in set(YAW) & set(motion.components):
            i = motion.components.index(name)
            known = known & (mode.covariance[i, i] < COURSE_LOST**2)
    return known


def placed(motions: Sequence[MotionModel], belief: AnyBelief, scan: Scan, where: Mask) -> AnyBelief:
    """The belief with the position that the measurements state in some places, and all else as it was."""
    position = SENSOR_MODELS[scan.kind].position(scan)
    spread = linalg.expand(position.covariance, position.mean[None])
    moved = []
    for motion, mode in zip(motions, _modes(belief), strict=True):
        own = [motion.components.index(name) for name in POSITION]
        mean, covariance = mode.mean.copy(), mode.covariance.copy()
        mean[own] = np.where(where, position.mean, mean[own])
        covariance[own] = np.where(where, 0.0, covariance[own])
        covariance[:, own] = np.where(where, 0.0, covariance[:, own])
        block = np.ix_(own, own)
        covariance[block] = np.where(where, spread, covariance[block])
        moved.append(Belief(mean, covariance, repaired=mode.repaired))
    return belief._replace(modes=tuple(moved)) if isinstance(belief, MultiModelBelief) else moved[0]


def _modes(belief: AnyBelief) -> tuple[Belief, ...]:
    return belief.modes if isinstance(belief, MultiModelBelief) else (belief,)

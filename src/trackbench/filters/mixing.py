"""Mixtures of what filters with different motion models believe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench import linalg
from trackbench.filters.base import wrap_components
from trackbench.models.motion import InitialSigmas, MotionModel
from trackbench.models.motion.base import POSITION, VELOCITY, YAW
from trackbench.types import Array, Gaussian
from trackbench.units import difference

#: What position and velocity determine.
DETERMINED = {*POSITION, *VELOCITY, *YAW}
#: What changes its sign where a motion is stated as one in the opposite direction.
ALONG_PATH = ("v", "a")


def moment_matched(weights: Array, parts: Sequence[Gaussian], around: Array, angular: tuple[int, ...]) -> Gaussian:
    """Mean and covariance of a mixture of Gaussians. Source: Bar-Shalom, Li and Kirubarajan (2001), section 1.4.16.

    Args:
        weights: ``(M, ...)``, with the sum one.
        parts: ``(M,)`` each with mean ``(n, ...)``.
        around: ``(n, ...)`` a state near the means, from which differences of angles are taken.
        angular: which components are angles.
    """
    away = np.stack([difference(part.mean, around, angular) for part in parts])
    shift = np.einsum("k...,ki...->i...", weights, away)
    covariance = linalg.gram(np.sqrt(weights)[:, None] * (away - shift))
    for weight, part in zip(weights, parts, strict=True):
        covariance += weight * part.covariance
    return Gaussian(wrap_components(around + shift, angular), covariance)


def in_state_of(motion: MotionModel, own: Gaussian, other_motion: MotionModel, other: Gaussian) -> Gaussian:
    """What another model's filter believes, in the state of ``motion``.

    Components that both states have are taken as they are. Where one has vx, vy and the other a speed and a yaw, the
    position and the velocity go by way of px, py, vx, vy, to first order. A component that the other model lacks has
    the mean and the covariance that the filter of ``motion`` itself believes: mixing then leaves it alone, where a zero
    would bias it. Source: Yuan et al. (2012), "A multiple IMM estimation approach with unbiased mixing for thrusting
    projectiles"; Granström, Willett and Bar-Shalom (2015), "Systematic approach to IMM mixing for unequal dimension
    states".
    """
    names, seen = motion.components, other_motion.components
    if {*names} & {*VELOCITY, *YAW} != {*seen} & {*VELOCITY, *YAW}:
        # Only what position and velocity determine is read of it.
        other = motion.from_cartesian(other_motion.cartesian_belief(other), InitialSigmas(1.0, 1.0))
        seen = tuple(name if name in DETERMINED else "" for name in names)
    if "v" in names and "yaw" in names:
        other = _facing(own.mean[names.index("yaw")], seen, other)
    if names == seen:
        return other
    shared = [name for name in names if name in seen]
    to, come = [names.index(name) for name in shared], [seen.index(name) for name in shared]
    lacking = [i for i in range(len(names)) if i not in to]
    mean, covariance = own.mean.copy(), np.zeros_like(own.covariance)
    mean[to] = other.mean[come]
    covariance[np.ix_(to, to)] = other.covariance[np.ix_(come, come)]
    covariance[np.ix_(lacking, lacking)] = own.covariance[np.ix_(lacking, lacking)]
    return Gaussian(mean, covariance)


def _facing(yaw: Array, names: tuple[str, ...], belief: Gaussian) -> Gaussian:
    """The belief, its yaw within a right angle of ``yaw``: at the opposite yaw and speed the motion is the same."""
    i = names.index("yaw")
    opposite = np.cos(belief.mean[i] - yaw) < 0.0
    if not np.any(opposite):
        return belief
    sign = np.ones_like(belief.mean)
    for name in set(ALONG_PATH) & set(names):
        sign[names.index(name)] = np.where(opposite, -1.0, 1.0)
    mean = sign * belief.mean
    mean[i] += np.where(opposite, np.pi, 0.0)
    return Gaussian(wrap_components(mean, (i,)), sign[:, None] * sign[None] * belief.covariance)

"""Mixtures of what filters with different motion models believe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian
from trackbench.base.units import cos_sin, difference, wrap_angle
from trackbench.filters.base import wrap_components
from trackbench.models.motion import InitialSigmas, MotionModel
from trackbench.models.motion.base import POSITION, UNKNOWN_ANGLE, VELOCITY, YAW

#: What position and velocity determine.
DETERMINED = {*POSITION, *VELOCITY, *YAW}
#: What changes its sign where a motion is stated as one in the opposite direction.
ALONG_PATH = ("v", "a")


def moment_matched(weights: Array | Sequence[Array], parts: Sequence[Gaussian], angular: tuple[int, ...]) -> Gaussian:
    """Mean and covariance of a mixture of Gaussians. Source: Bar-Shalom, Li and Kirubarajan (2001), section 1.4.16.

    The parts are joined one after the other, which gives the same as all at once.

    Args:
        weights: of each part, ``(...)``, with the sum one; the first is positive.
        parts: each with mean ``(n, ...)``.
        angular: which components are angles.
    """
    (mean, covariance), total = parts[0], weights[0]
    for weight, part in zip(weights[1:], parts[1:], strict=True):
        total = total + weight
        share = weight / total
        away = difference(part.mean, mean, angular)
        spread = np.sqrt(share * (1.0 - share)) * away
        joined = part.covariance - covariance
        joined *= share
        joined += covariance
        joined += spread[:, None] * spread
        mean, covariance = wrap_components(mean + share * away, angular), joined
    return Gaussian(mean, covariance)


def in_state_of(motion: MotionModel, own: Gaussian, other_motion: MotionModel, other: Gaussian) -> Gaussian:
    """What another model's filter believes, in the state of ``motion``.

    Components that both states have are taken as they are. Where one has vx, vy and the other a speed and a yaw, the
    position and the velocity go by way of px, py, vx, vy, to first order. A component that the other model lacks has
    the mean and the variance that the filter of ``motion`` itself believes, so that mixing leaves it alone, where a
    zero would bias it; and so has the yaw where the velocity leaves it open. Source: Yuan et al. (2012), "A multiple
    IMM estimation approach with unbiased mixing for thrusting projectiles"; Granström, Willett and Bar-Shalom (2015),
    "Systematic approach to IMM mixing for unequal dimension states".
    """
    names, seen = motion.components, other_motion.components
    if {*names} & {*VELOCITY, *YAW} != {*seen} & {*VELOCITY, *YAW}:
        cartesian = other_motion.cartesian_belief(other)
        # Only what position and velocity determine is read of it.
        other = motion.from_cartesian(cartesian, InitialSigmas(1.0, 1.0))
        seen = tuple(name if name in DETERMINED else "" for name in names)
        if "v" in names and "yaw" in names:
            other = _yaw_left_open(own, names, other, cartesian)
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


def _yaw_left_open(own: Gaussian, names: tuple[str, ...], other: Gaussian, cartesian: Gaussian) -> Gaussian:
    """``other`` with the own yaw, and the speed along it, where the velocity says nothing of the yaw."""
    places = [names.index(name) for name in ("px", "py", "v")]
    yaw = names.index("yaw")
    unknown = other.covariance[yaw, yaw] > 0.999 * UNKNOWN_ANGLE**2
    if not np.any(unknown):
        return other
    c, s = cos_sin(own.mean[yaw])
    slope = linalg.matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]])
    mean, covariance = other.mean.copy(), np.zeros_like(other.covariance)
    mean[places] = linalg.apply(slope, cartesian.mean)
    mean[yaw] = own.mean[yaw]
    covariance[np.ix_(places, places)] = linalg.symmetrise(linalg.quadratic(slope, cartesian.covariance))
    covariance[yaw, yaw] = own.covariance[yaw, yaw]
    return Gaussian(mean, covariance).where(unknown, other)


def _facing(yaw: Array, names: tuple[str, ...], belief: Gaussian) -> Gaussian:
    """The belief, its yaw within a right angle of ``yaw``: at the opposite yaw and speed the motion is the same."""
    i = names.index("yaw")
    opposite = np.abs(wrap_angle(belief.mean[i] - yaw)) > np.pi / 2
    if not np.any(opposite):
        return belief
    sign = np.ones_like(belief.mean)
    for name in set(ALONG_PATH) & set(names):
        sign[names.index(name)] = np.where(opposite, -1.0, 1.0)
    mean = sign * belief.mean
    mean[i] += np.where(opposite, np.pi, 0.0)
    return Gaussian(wrap_components(mean, (i,)), sign[:, None] * sign[None] * belief.covariance)

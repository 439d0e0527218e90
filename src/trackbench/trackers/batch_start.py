"""Where tracks start that a batch of measurements starts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Mask, some
from trackbench.engine.equations import Compute, by_numpy
from trackbench.filters.mixing import moment_matched
from trackbench.models.motion import MotionModel
from trackbench.trackers.batch_fit import BatchPrior, fit_from
from trackbench.trackers.first_measurements import FirstMeasurements
from trackbench.trackers.fit_search import Fit, put
from trackbench.trackers.line_fit import fit_line

#: Of two motions whose costs differ by more, the other one has odds of less than 1 to 99.
SURE = 2.0 * float(np.log(99.0))
#: Squared distance of two velocities, in variances, from which they are two.
APART = 9.0


class StraightLine(NamedTuple):
    """The motion at constant velocity that some measurements say, px, py, vx, vy, of each object."""

    first: Array
    """``(4, L)`` at the first measurement."""
    latest: Gaussian
    """``(4, L)`` at the latest."""
    other: Array
    """``(4, L)`` at the first measurement, the second best."""
    ambiguous: Mask
    """``(L,)`` whether that one explains the measurements nearly as well."""

    def part(self, where: Mask) -> StraightLine:
        """Of some objects."""
        return StraightLine(
            some(self.first, where), self.latest.part(where), some(self.other, where), self.ambiguous[where]
        )


def straight_line(measurements: FirstMeasurements, prior: BatchPrior, compute: Compute = by_numpy) -> StraightLine:
    """The best straight line, and whether the measurements leave two.

    Range rates tell the square of the velocity across the line of sight, by its centrifugal term; which way it points
    only the azimuths tell, and at first not well. So the search begins on both sides.
    """
    if not any("range_rate" in sensor.components for sensor in measurements.kinds):
        one = _undriven(np.zeros_like(measurements.position), measurements, prior, compute)
        return StraightLine(one.first, one.latest, one.first, np.zeros(one.cost.shape, dtype=bool))
    across = _across(measurements)
    one, two = (_undriven(sign * prior.velocity * across, measurements, prior, compute) for sign in (1.0, -1.0))
    ambiguous, apart = _nearly_alike(one, two), _apart(one, two)
    if np.any(apart):
        here = measurements.part(apart)
        for fit in (one, two):
            put(fit, apart, fit_from(some(fit.first, apart), prior.driven_line, here, prior, compute))
        ambiguous |= _nearly_alike(one, two)
    better = one.cost <= two.cost
    return StraightLine(
        np.where(better, one.first, two.first),
        one.latest.where(better, two.latest),
        np.where(better, two.first, one.first),
        ambiguous,
    )


def _nearly_alike(one: Fit, two: Fit) -> Mask:
    """``(L,)`` whether two fits with different velocities explain the measurements nearly alike."""
    return _apart(one, two) & (np.abs(one.cost - two.cost) < SURE)


def _apart(one: Fit, two: Fit) -> Mask:
    """``(L,)`` whether two fits have different velocities at the latest measurement."""
    away = (one.latest.mean - two.latest.mean)[2:]
    return np.asarray((away**2).sum(axis=0) > APART * np.einsum("ii...->...", one.latest.covariance[2:, 2:]))


def start_state(
    motion: MotionModel,
    measurements: FirstMeasurements,
    prior: BatchPrior,
    line: StraightLine,
    compute: Compute = by_numpy,
) -> Gaussian:
    """``(n, L)`` the most probable state at the latest measurement, with its covariance.

    It is looked for from the straight line. Where that does not come to rest, the straight line under white
    acceleration stands in its place. Of two motions that explain the measurements nearly alike it is the mixture's mean
    and covariance.
    """
    own = fit_from(_begin(motion, line.first, prior), motion, measurements, prior, compute)
    found = own.latest
    if not own.converged.all():
        other = fit_from(line.first, prior.driven_line, measurements, prior, compute).latest
        found = found.where(own.converged, motion.from_cartesian(other, prior.others))
    where = line.ambiguous
    if np.any(where):
        begin = _begin(motion, some(line.other, where), prior)
        second = fit_from(begin, motion.part(where), measurements.part(where), prior, compute)
        weight = 1.0 / (1.0 + np.exp(np.clip(0.5 * (second.cost - own.cost[where]), -700.0, 700.0)))
        both = [found.part(where), second.latest]
        put(found, where, moment_matched([1.0 - weight, weight], both, motion.angular))
    return found


def _begin(motion: MotionModel, line: Array, prior: BatchPrior) -> Array:
    """``(n, L)`` the state of px, py, vx, vy; which does not depend on how well they are known."""
    known = np.broadcast_to(np.eye(4)[..., None], (4, *line.shape))
    return motion.from_cartesian(Gaussian(line, known), prior.others).mean


def _undriven(velocity: Array, measurements: FirstMeasurements, prior: BatchPrior, compute: Compute) -> Fit:
    return fit_line(np.concatenate([measurements.position, velocity]), measurements, prior.velocity, compute)


def _across(measurements: FirstMeasurements) -> Array:
    """``(2, L)`` the direction across the first line of sight."""
    x, y = measurements.position - measurements.pose[0, :2]
    return np.asarray(np.stack([-y, x]) / np.maximum(np.hypot(x, y), 1e-9))

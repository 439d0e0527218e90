"""The state that a few measurements say, by Gauss-Newton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.models.motion import ConstantVelocity, InitialSigmas, MotionModel
from trackbench.models.motion.base import POSITION, VELOCITY, YAW, first_sigma
from trackbench.trackers.first_measurements import FirstMeasurements
from trackbench.types import Array, Gaussian, Mask
from trackbench.units import difference

#: Steps after which a fit that still moves counts as not converged.
MOST_STEPS = 12
#: Length of a step below which a fit has converged, in standard deviations.
CONVERGED = 0.05
#: Factor by which the damping grows after a step that raised the cost, and falls after one that did not.
DAMPING = 10.0


class BatchPrior(NamedTuple):
    """What is assumed of the first state beside the measurements."""

    velocity: float
    """Standard deviation of either component of a velocity whose mean is zero, m/s."""
    others: InitialSigmas

    @property
    def driven_line(self) -> ConstantVelocity:
        """A straight line under the white acceleration that is assumed."""
        return ConstantVelocity(acceleration_sigma_mps2=self.others.acceleration)


class Fit(NamedTuple):
    """A fit of each object."""

    first: Gaussian
    """``(n, L)`` the state at the first measurement."""
    latest: Gaussian
    """``(n, L)`` the state at the latest."""
    cost: Array
    """``(L,)`` sum of the squares of the normalised residuals."""
    converged: Mask
    """``(L,)``"""


def fit_from(
    first: Array,
    motion: MotionModel,
    measurements: FirstMeasurements,
    prior: BatchPrior,
    *,
    driven: bool = True,
    steps: int = MOST_STEPS,
) -> Fit:
    """The most probable states at the first and the latest measurement, of the motion model and its own process noise.

    What is sought is the first state and each driving noise from one measurement to the next, by damped Gauss-Newton on
    the sum of the squares of all normalised residuals; the covariance is the inverse of the information matrix, carried
    to the latest measurement. For a linear model and measurement it is the Kalman filter's state, exactly.

    Args:
        first: ``(n, L)`` state at the first measurement where the search begins.
        motion: the model.
        measurements: of L objects.
        prior: what is assumed beside them.
        driven: whether there is process noise.
        steps: after which a fit that still moves counts as not converged.

    Source: Bar-Shalom, Li and Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation", section
    3.4 (nonlinear least squares), with the process noise among the unknowns as in Bell (1994), "The iterated Kalman
    smoother as a Gauss-Newton method".
    """
    size, lanes = first.shape
    noises = len(motion.noise_sigma) * len(measurements.interval) * driven
    found = np.concatenate([first, np.zeros((noises, lanes))])
    at = _Linearised.of(motion, measurements, prior, found)
    damping, converged = np.full(lanes, 1e-6), np.zeros(lanes, dtype=bool)
    for _ in range(steps):
        moving = _index(~converged)
        now = at.part(moving)
        step = _solved(now.information, now.gradient, damping[moving])
        tried = found[:, moving] + step
        there = _Linearised.of(motion.part(moving), measurements.part(moving), prior, tried)
        better = there.cost <= now.cost * (1.0 + 1e-12)
        length = np.einsum("i...,ij...,j...->...", step, now.information, step)
        for whole, new in zip((found, *at), (tried, *there), strict=True):
            whole[..., moving] = np.where(better, new, whole[..., moving])
        factor = np.where(better, 1.0 / DAMPING, DAMPING * DAMPING)
        damping[moving] = np.clip(damping[moving] * factor, 1e-12, 1e12)
        converged[moving] = (length < CONVERGED**2) & (better | (length < 1e-12))
        if converged.all():
            break
    identity = np.broadcast_to(np.eye(len(found))[..., None], (*at.information.shape,))
    inverse = linalg.symmetrise(_solved(at.information, identity, np.zeros(lanes)))
    covariance = linalg.symmetrise(linalg.quadratic(at.slope, inverse))
    earliest = Gaussian(found[:size], inverse[:size, :size])
    latest = Gaussian(difference(at.latest, np.zeros(()), motion.angular), covariance)
    return Fit(earliest, latest, at.cost, converged & np.isfinite(covariance).all(axis=(0, 1)))


class _Linearised(NamedTuple):
    """The sum of squares at one point ``(p, L)`` of first states and driving noises."""

    cost: Array
    """``(L,)``"""
    information: Array
    """``(p, p, L)``"""
    gradient: Array
    """``(p, L)`` downhill."""
    latest: Array
    """``(n, L)`` the state to which the point leads."""
    slope: Array
    """``(n, p, L)`` its derivative."""

    def part(self, where: Mask | slice) -> _Linearised:
        """That of some objects."""
        return _Linearised(*(item[..., where] for item in self))

    @classmethod
    def of(cls, motion: MotionModel, measurements: FirstMeasurements, prior: BatchPrior, point: Array) -> _Linearised:
        size, (unknowns, lanes) = len(motion.components), point.shape
        sigma = np.asarray(linalg.expand(linalg.vector(motion.noise_sigma), point)) * np.ones(lanes)
        x, noises = point[:size], point[size:].reshape(-1, len(sigma), lanes)
        slope = np.zeros((size, size, lanes))
        slope[range(size), range(size)] = 1.0
        cost = (point[size:] ** 2).sum(axis=0)
        information = np.zeros((unknowns, unknowns, lanes))
        information[range(size, unknowns), range(size, unknowns)] = 1.0
        gradient = np.concatenate([np.zeros_like(x), -point[size:]])
        parts = [_of_prior(motion, prior, x)]
        for k in range(len(measurements.kind)):
            if k:
                x, slope = _moved(motion, measurements.interval[k - 1], x, slope, sigma, noises[k - 1 : k])
            parts.append(_of_measurement(motion, measurements, k, x, slope))
        for residual, derivative in parts:
            # What comes later has no part in a measurement.
            known = derivative.shape[1]
            cost += np.einsum("i...,i...->...", residual, residual)
            information[:known, :known] += linalg.gram(derivative)
            gradient[:known] += linalg.apply_transposed(derivative, residual)
        for i, name in enumerate(motion.components):
            if name in YAW:
                # Nothing pulls at the course, but no more is unknown of it than of any angle.
                information[i, i] += prior.others.yaw**-2
        return cls(cost, information, gradient, x, slope)


def _of_prior(motion: MotionModel, prior: BatchPrior, x: Array) -> tuple[Array, Array]:
    """The residuals ``(r, L)`` of what is assumed of the first state, and the derivatives ``(r, n, L)`` of what they
    are of."""
    size, sigma = len(x), prior.velocity
    velocity = linalg.expand(motion.cartesian_jacobian(x)[2:], x[None])
    open_ = [i for i, name in enumerate(motion.components) if name not in (*POSITION, *VELOCITY, *YAW)]
    scale = np.array([first_sigma(motion, motion.components[i], prior.others) for i in open_])[:, None]
    rows = np.broadcast_to((np.eye(size)[open_] / scale)[..., None], (len(open_), *x.shape))
    residual = np.concatenate([-motion.to_cartesian(x)[2:] / sigma, -x[open_] / scale])
    return residual, np.concatenate([np.broadcast_to(velocity, (2, *x.shape)) / sigma, rows])


def _moved(
    motion: MotionModel, interval: Array, x: Array, slope: Array, sigma: Array, noise: Array
) -> tuple[Array, Array]:
    """The state after the interval and its derivative, which gains a column for each of the interval's noises.

    ``noise`` is ``(1, q, L)``, or empty where there is none.
    """
    own = np.zeros((len(x), noise.size // x.shape[1], x.shape[1]))
    after, turned = x.copy(), np.concatenate([slope, own], axis=1)
    known = slope.shape[1]
    for dt in np.unique(interval[interval > 0.0]):
        where = _index(interval == dt)
        here, before = x[:, where], slope[..., where]
        after[:, where] = motion.transition(here, dt)
        turned[:, :known, where] = linalg.matmul(linalg.expand(motion.jacobian(here, dt), before), before)
        for drawn in noise:
            gain = sigma[:, where] * linalg.expand(motion.noise_gain(here, dt), before)
            after[:, where] += linalg.apply(gain, drawn[:, where])
            turned[:, known:, where] = gain
    return after, turned


def _of_measurement(
    motion: MotionModel, measurements: FirstMeasurements, k: int, x: Array, slope: Array
) -> tuple[Array, Array]:
    value, whitener = measurements.value[k], measurements.whitener[k]
    target, way = motion.to_cartesian(x), motion.cartesian_jacobian(x)
    residual, derivative = np.zeros_like(value), np.zeros((len(value), *slope.shape[1:]))
    for number, sensor in enumerate(measurements.kinds):
        there = measurements.kind[k] == number
        if not there.any():
            continue
        where = _index(there)
        at = target[:, where], measurements.pose[k][:, where], measurements.velocity[k][:, where]
        size = len(sensor.components)
        residual[:size, where] = difference(value[:size, where], sensor.measure(*at), sensor.angular)
        h = sensor.jacobian(*at)
        h = np.broadcast_to(linalg.expand(h, at[0][None]), (size, 4, at[0].shape[1]))
        own = np.broadcast_to(linalg.expand(way, target[None]), (4, len(x), len(there)))[..., where]
        whitened = linalg.matmul(linalg.matmul(whitener[:, :size, where], h), own)
        derivative[:, :, where] = linalg.matmul(whitened, slope[..., where])
    return linalg.apply(whitener, residual), derivative


def _index(where: Mask) -> Mask | slice:
    """Of all, a slice: no copy is made."""
    return slice(None) if where.all() else where


def _solved(information: Array, right: Array, damping: Array) -> Array:
    """``(I + damping diag(I))^-1 right`` for every object, ``right`` a vector ``(p, L)`` or a matrix ``(p, q, L)``."""
    a = np.moveaxis(information, -1, 0)
    damped = a + damping[:, None, None] * np.einsum("lii->li", a)[:, :, None] * np.eye(a.shape[1])
    b = np.moveaxis(right, -1, 0)
    found = np.linalg.solve(damped, b if b.ndim == 3 else b[..., None])
    return np.moveaxis(found if b.ndim == 3 else found[..., 0], 0, -1)

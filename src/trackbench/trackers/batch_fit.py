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
#: Share of the sum of squares below which what a step would gain is rounding.
NOTHING = 1e-12
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

    first: Array
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
    the sum of the squares of all normalised residuals. Each of its steps is a Kalman filter through the linearised
    measurements and a smoother back; the filter's last covariance is the fit's. For a linear model and measurement it
    is the Kalman filter's state, exactly.

    Args:
        first: ``(n, L)`` state at the first measurement where the search begins.
        motion: the model.
        measurements: of L objects.
        prior: what is assumed beside them.
        driven: whether there is process noise.
        steps: after which a fit that still moves counts as not converged.

    Source: Bell (1994), "The iterated Kalman smoother as a Gauss-Newton method"; the smoother of the driving noises is
    that of Koopman (1993), "Disturbance smoother for state space models".
    """
    lanes = first.shape[-1]
    noise = (len(measurements.interval), len(motion.noise_sigma)) if driven else (0, 0)
    found = _Point(first.copy(), np.zeros((*noise, lanes)))
    at = _Linearised.of(motion, measurements, prior, found)
    damping, converged = np.full(lanes, 1e-6), np.zeros(lanes, dtype=bool)
    for _ in range(steps):
        moving = _index(~converged)
        now = at.part(moving)
        step, gain = now.step(damping[moving])
        tried = found.part(moving).moved(step)
        there = _Linearised.of(motion.part(moving), measurements.part(moving), prior, tried)
        better = there.cost <= now.cost * (1.0 + 1e-12)
        for whole, new in zip((*found, *at), (*tried, *there), strict=True):
            whole[..., moving] = np.where(better, new, whole[..., moving])
        factor = np.where(better, 1.0 / DAMPING, DAMPING * DAMPING)
        damping[moving] = np.clip(damping[moving] * factor, 1e-12, 1e12)
        converged[moving] = (gain < CONVERGED**2) & (better | (gain < NOTHING * now.cost))
        if converged.all():
            break
    covariance = at.covariance
    latest = Gaussian(difference(at.latest, np.zeros(()), motion.angular), covariance)
    return Fit(found.first, latest, at.cost, converged & np.isfinite(covariance).all(axis=(0, 1)))


class _Point(NamedTuple):
    """What is sought."""

    first: Array
    """``(n, L)`` the first state."""
    noise: Array
    """``(K - 1, q, L)`` each driving noise from one measurement to the next, in standard deviations; empty where there
    is none."""

    def part(self, where: Mask | slice) -> _Point:
        """That of some objects."""
        return _Point(self.first[..., where], self.noise[..., where])

    def moved(self, step: _Point) -> _Point:
        """That a step away."""
        return _Point(self.first + step.first, self.noise + step.noise)


class _Filtered(NamedTuple):
    """A Kalman filter through the linearised measurements, for what is to be added to a point."""

    earliest: Gaussian
    """``(n, L)`` of the first state, after what is known of it and the first measurement."""
    innovation: list[Array]
    """``(n, L)`` of each later measurement, times ``H^T S^-1``."""
    kept: list[Array]
    """``(n, n, L)`` ``I - K H`` of each later measurement."""
    cost: Array
    """``(L,)`` the least that the linearised sum of squares can be."""
    covariance: Array
    """``(n, n, L)`` of the latest state."""


class _Linearised(NamedTuple):
    """The sum of squares about a point."""

    cost: Array
    """``(L,)``"""
    latest: Array
    """``(n, L)`` the state to which the point leads."""
    reach: Array
    """``(n, n, L)`` its derivative by the last state that the filter comes to."""
    information: Array
    """``(n, n, L)`` of the first state, from what is assumed of it and the first measurement; from all of them where
    there is no process noise, which leaves nothing to the filter."""
    gradient: Array
    """``(n, L)`` by the first state, downhill, of what these two cost."""
    noise: Array
    """``(K - 1, q, L)`` the point's."""
    transition: Array
    """``(K - 1, n, n, L)`` derivative of each next state by the one before."""
    gain: Array
    """``(K - 1, n, q, L)`` and by the noise."""
    residual: Array
    """``(K, m, L)`` of the measurements, in standard deviations."""
    slope: Array
    """``(K, m, n, L)`` derivative of what is expected of them by the state."""

    def part(self, where: Mask | slice) -> _Linearised:
        """That of some objects."""
        return _Linearised(*(item[..., where] for item in self))

    @classmethod
    def of(cls, motion: MotionModel, measurements: FirstMeasurements, prior: BatchPrior, point: _Point) -> _Linearised:
        (size, lanes), gaps, noises = point.first.shape, len(measurements.interval), point.noise.shape[1]
        sigma = np.asarray(linalg.expand(linalg.vector(motion.noise_sigma), point.first)) * np.ones(lanes)
        states = np.empty((size, gaps + 1, lanes))
        states[:, 0] = point.first
        transition, gain = np.empty((gaps, size, size, lanes)), np.empty((gaps, size, noises, lanes))
        for k, interval in enumerate(measurements.interval):
            here = states[:, k]
            for dt in np.unique(interval):
                where = _index(interval == dt)
                x = here[:, where]
                transition[k][..., where] = linalg.expand(motion.jacobian(x, dt), x[None])
                states[:, k + 1, where] = motion.transition(x, dt)
                if noises:
                    gain[k][..., where] = linalg.expand(motion.noise_gain(x, dt), x[None]) * sigma[:, where]
            if noises:
                states[:, k + 1] += linalg.apply(gain[k], point.noise[k])
        residual, slope = _of_measurements(motion, measurements, states)
        reach = np.eye(size)[..., None] * np.ones(lanes)
        if not noises:
            # Every state is the first one's: all measurements tell of it at once.
            for k, one in enumerate(transition):
                reach = linalg.matmul(one, reach)
                slope[k + 1] = linalg.matmul(slope[k + 1], reach)
            residual, slope = residual.reshape(1, -1, lanes), slope.reshape(1, -1, size, lanes)
            transition, gain = transition[:0], gain[:0]
        assumed, by_first = _of_prior(motion, prior, point.first)
        information = linalg.gram(by_first) + linalg.gram(slope[0])
        for i, name in enumerate(motion.components):
            if name in YAW:
                # Nothing pulls at the course, but no more is unknown of it than of any angle.
                information[i, i] += prior.others.yaw**-2
        gradient = linalg.apply_transposed(by_first, assumed) + linalg.apply_transposed(slope[0], residual[0])
        cost = (assumed**2).sum(axis=0) + (residual**2).sum(axis=(0, 1)) + (point.noise**2).sum(axis=(0, 1))
        return cls(cost, states[:, -1], reach, information, gradient, point.noise, transition, gain, residual, slope)

    @property
    def covariance(self) -> Array:
        """``(n, n, L)`` of the latest state."""
        return linalg.symmetrise(linalg.quadratic(self.reach, self.filtered(np.zeros_like(self.cost)).covariance))

    def filtered(self, damping: Array) -> _Filtered:
        """The filter; the damping ``(L,)`` is added to the weights of what is sought, as a share of them."""
        own = np.eye(len(self.latest))[..., None]
        known = linalg.cholesky(self.information * (1.0 + damping * own))
        covariance = np.where(known.positive, linalg.gram(known.whiten(own)), np.nan)
        mean = linalg.apply(covariance, self.gradient)
        earliest = Gaussian(mean, covariance)
        cost = self.cost - (self.residual[1:] ** 2).sum(axis=(0, 1)) - np.einsum("i...,i...->...", self.gradient, mean)
        rest = 1.0 / (1.0 + damping)
        cost -= rest * (self.noise**2).sum(axis=(0, 1))
        innovations, kept = [], []
        for a, b, drawn, z, h in zip(
            self.transition, self.gain, self.noise, self.residual[1:], self.slope[1:], strict=True
        ):
            mean = linalg.apply(a, mean) - rest * linalg.apply(b, drawn)
            covariance = linalg.quadratic(a, covariance) + rest * linalg.matmul_transposed(b, b)
            across = linalg.matmul(h, covariance)
            factor = linalg.cholesky(linalg.matmul_transposed(across, h) + np.eye(len(z))[..., None])
            innovation = factor.whiten(z - linalg.apply(h, mean))
            white, by_state = factor.whiten(across), factor.whiten(h)
            cost += (innovation**2).sum(axis=0)
            mean = mean + linalg.apply_transposed(white, innovation)
            kept.append(own - linalg.matmul(np.swapaxes(white, 0, 1), by_state))
            innovations.append(linalg.apply_transposed(by_state, innovation))
            covariance = linalg.symmetrise(covariance - linalg.gram(white))
        return _Filtered(earliest, innovations, kept, cost, covariance)

    def step(self, damping: Array) -> tuple[_Point, Array]:
        """A damped step of Gauss-Newton, and by how much it would lower the sum of squares if all were linear."""
        filtered = self.filtered(damping)
        rest = 1.0 / (1.0 + damping)
        noise = np.empty_like(self.noise)
        back = np.zeros_like(self.latest)
        for k in reversed(range(len(self.transition))):
            back = filtered.innovation[k] + linalg.apply_transposed(filtered.kept[k], back)
            noise[k] = rest * (linalg.apply_transposed(self.gain[k], back) - self.noise[k])
            back = linalg.apply_transposed(self.transition[k], back)
        mean, covariance = filtered.earliest
        return _Point(mean + linalg.apply(covariance, back), noise), self.cost - filtered.cost


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


def _of_measurements(motion: MotionModel, measurements: FirstMeasurements, states: Array) -> tuple[Array, Array]:
    """The residuals ``(K, m, L)`` in states ``(n, K, L)``, and the derivatives ``(K, m, n, L)`` of what is expected."""
    value, whitener = measurements.value, measurements.whitener
    residual, slope = np.zeros_like(value), np.zeros((*value.shape[:2], len(states), value.shape[-1]))
    for number, sensor in enumerate(measurements.kinds):
        k, lane = np.nonzero(measurements.kind == number)
        size = len(sensor.components)
        x = states[:, k, lane]
        target = motion.to_cartesian(x)
        at = target, measurements.pose[k, :, lane].T, measurements.velocity[k, :, lane].T
        off = difference(value[k, :size, lane].T, sensor.measure(*at), sensor.angular)
        by_target = linalg.matmul(np.moveaxis(whitener[k, :size, :size, lane], 0, -1), _spread(sensor.jacobian(*at), x))
        by_state = linalg.matmul(by_target, _spread(motion.cartesian_jacobian(x), x))
        residual[k, :size, lane] = linalg.apply(np.moveaxis(whitener[k, :size, :size, lane], 0, -1), off).T
        slope[k, :size, :, lane] = np.moveaxis(by_state, -1, 0)
    return residual, slope


def _spread(a: Array, x: Array) -> Array:
    """A matrix for each of the states ``(n, L)``."""
    return np.broadcast_to(linalg.expand(a, x[None]), (*a.shape[:2], x.shape[-1]))


def _index(where: Mask) -> Mask | slice:
    """Of all, a slice: no copy is made."""
    return slice(None) if where.all() else where

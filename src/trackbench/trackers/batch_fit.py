"""The state that a few measurements say, by Gauss-Newton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.engine.equations import Compute, by_numpy
from trackbench.models.motion import ConstantVelocity, InitialSigmas, MotionModel
from trackbench.models.motion.base import POSITION, VELOCITY, YAW, first_sigma
from trackbench.trackers.first_measurements import FirstMeasurements, places
from trackbench.trackers.fit_equations import BACK, FORTH, measured, moved
from trackbench.trackers.fit_search import Fit, damped, index, searched
from trackbench.types import Array, Gaussian, Mask
from trackbench.units import difference


class BatchPrior(NamedTuple):
    """What is assumed of the first state beside the measurements."""

    velocity: float
    """Standard deviation of either component of a velocity whose mean is zero, m/s."""
    others: InitialSigmas

    @property
    def driven_line(self) -> ConstantVelocity:
        """A straight line under the white acceleration that is assumed."""
        return ConstantVelocity(acceleration_sigma_mps2=self.others.acceleration)


def fit_from(
    first: Array,
    motion: MotionModel,
    measurements: FirstMeasurements,
    prior: BatchPrior,
    compute: Compute = by_numpy,
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
        compute: how equations are computed.

    Source: Bell (1994), "The iterated Kalman smoother as a Gauss-Newton method"; the smoother of the driving noises is
    that of Koopman (1993), "Disturbance smoother for state space models".
    """
    noise = np.zeros((len(measurements.interval), len(motion.noise_sigma), first.shape[-1]))

    def about(point: _Point, where: Mask | slice) -> _Linearised:
        return _Linearised.of(motion.part(where), measurements.part(where), prior, point, compute)

    found, at, converged = searched(_Point(first.copy(), noise), about)
    covariance = at.filtered(np.zeros_like(at.cost)).covariance
    latest = Gaussian(difference(at.latest, np.zeros(()), motion.angular), covariance)
    return Fit(found.first, latest, at.cost, converged & np.isfinite(covariance).all(axis=(0, 1)))


class _Point(NamedTuple):
    """What is sought."""

    first: Array
    """``(n, L)`` the first state."""
    noise: Array
    """``(K - 1, q, L)`` each driving noise from one measurement to the next, in standard deviations."""

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
    information: Array
    """``(n, n, L)`` of the first state, from what is assumed of it and the first measurement."""
    gradient: Array
    """``(n, L)`` by the first state, downhill, of what these two cost."""
    noise: Array
    """``(K - 1, q, L)`` the point's."""
    transition: Array
    """``(K - 1, n, n, L)`` derivative of each next state by the one before."""
    gain: Array
    """``(K - 1, n, q, L)`` and by the noise."""
    residual: Array
    """``(m, K, L)`` of the measurements, in standard deviations."""
    slope: Array
    """``(m, n, K, L)`` derivative of what is expected of them by the state."""
    compute: Compute

    def part(self, where: Mask | slice) -> _Linearised:
        """That of some objects."""
        own = {name: item[..., where] for name, item in self._asdict().items() if name != "compute"}
        return self._replace(**own)

    @classmethod
    def of(
        cls,
        motion: MotionModel,
        measurements: FirstMeasurements,
        prior: BatchPrior,
        point: _Point,
        compute: Compute,
    ) -> _Linearised:
        (size, lanes), (gaps, noises, _) = point.first.shape, point.noise.shape
        states = np.empty((gaps + 1, size, lanes))
        states[0] = point.first
        transition, gain = np.empty((gaps, size, size, lanes)), np.empty((gaps, size, noises, lanes))
        for k, interval in enumerate(measurements.interval):
            for dt in np.unique(interval):
                where = index(interval == dt)
                equations, options = moved(motion.part(where))
                given = {"x": states[k][:, where], "noise": point.noise[k][:, where], "dt": float(dt)}
                said = compute(equations, given | options)
                states[k + 1][:, where], transition[k][..., where] = said["next"], said["transition"]
                gain[k][..., where] = said["gain"]
        residual, slope = _of_measurements(motion, measurements, np.swapaxes(states, 0, 1), compute)
        assumed, by_first = _of_prior(motion, prior, point.first)
        information = linalg.gram(by_first) + linalg.gram(slope[:, :, 0])
        for i, name in enumerate(motion.components):
            if name in YAW:
                # Nothing pulls at the course, but no more is unknown of it than of any angle.
                information[i, i] += prior.others.yaw**-2
        gradient = linalg.apply_transposed(by_first, assumed) + linalg.apply_transposed(slope[:, :, 0], residual[:, 0])
        cost = (assumed**2).sum(axis=0) + (residual**2).sum(axis=(0, 1)) + (point.noise**2).sum(axis=(0, 1))
        return cls(cost, states[-1], information, gradient, point.noise, transition, gain, residual, slope, compute)

    def filtered(self, damping: Array) -> _Filtered:
        """The filter; the damping ``(L,)`` is added to the weights of what is sought, as a share of them."""
        earliest = damped(self.information, self.gradient, damping, self.compute)
        mean, covariance = earliest
        cost = self.cost - (self.residual[:, 1:] ** 2).sum(axis=(0, 1))
        cost -= np.einsum("i...,i...->...", self.gradient, mean)
        cost -= (self.noise**2).sum(axis=(0, 1)) / (1.0 + damping)
        innovations, kept = [], []
        for k, (transition, gain, noise) in enumerate(zip(self.transition, self.gain, self.noise, strict=True)):
            given = {
                "mean": mean,
                "covariance": covariance,
                "damping": damping,
                "transition": transition,
                "gain": gain,
                "noise": noise,
                "residual": self.residual[:, k + 1],
                "slope": self.slope[:, :, k + 1],
            }
            said = self.compute(FORTH, given)
            mean, covariance = said["mean"], said["covariance"]
            cost += said["cost"]
            innovations.append(said["innovation"])
            kept.append(said["kept"])
        return _Filtered(earliest, innovations, kept, cost, covariance)

    def step(self, damping: Array) -> tuple[_Point, Array]:
        """A damped step of Gauss-Newton, and by how much it would lower the sum of squares if all were linear."""
        filtered = self.filtered(damping)
        noise = np.empty_like(self.noise)
        back = np.zeros_like(self.latest)
        for k in reversed(range(len(self.transition))):
            given = {
                "back": back,
                "damping": damping,
                "innovation": filtered.innovation[k],
                "kept": filtered.kept[k],
                "transition": self.transition[k],
                "gain": self.gain[k],
                "noise": self.noise[k],
            }
            said = self.compute(BACK, given)
            noise[k], back = said["noise"], said["back"]
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


def _of_measurements(
    motion: MotionModel, measurements: FirstMeasurements, states: Array, compute: Compute
) -> tuple[Array, Array]:
    """The residuals ``(m, K, L)`` in states ``(n, K, L)``, and the derivatives ``(m, n, K, L)`` of what is expected."""
    value, whitener = measurements.value, measurements.whitener
    residual, slope = np.zeros_like(value), np.zeros((len(value), *states.shape))
    for number, sensor in enumerate(measurements.kinds):
        size, at = len(sensor.components), places(measurements.kind == number)
        given = {
            "x": states[:, *at],
            "value": value[:size, *at],
            "whitener": whitener[:size, :size, *at],
            "pose": measurements.pose[:, *at],
            "velocity": measurements.velocity[:, *at],
        }
        equations, options = measured(motion.part(at[1]), sensor)
        said = compute(equations, given | options)
        residual[:size, *at], slope[:size, :, *at] = said["residual"], said["slope"]
    return residual, slope

"""The state that a few measurements say, by Gauss-Newton."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Mask
from trackbench.base.units import difference
from trackbench.engine.equations import Compute, by_numpy
from trackbench.models.motion import ConstantVelocity, InitialSigmas, MotionModel
from trackbench.trackers.first_measurements import FirstMeasurements
from trackbench.trackers.fit_equations import BACK, first_state, forth, own_numbers
from trackbench.trackers.fit_search import About, Fit, Unknowns, searched


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
    given = {"prior": np.array([prior.velocity, *prior.others])}
    found = searched(_Driven(motion, measurements, given, compute), Unknowns(first.copy(), noise))
    latest = found.latest
    return found._replace(latest=latest._replace(mean=difference(latest.mean, np.zeros(()), motion.angular)))


class _Driven(NamedTuple):
    """The sum of squares of a motion that noise drives."""

    motion: MotionModel
    measurements: FirstMeasurements
    prior: Mapping[str, Array]
    compute: Compute

    def part(self, where: Mask) -> _Driven:
        return self._replace(motion=self.motion.part(where), measurements=self.measurements.part(where))

    def about(self, point: Unknowns, damping: Array) -> About:
        """By a Kalman filter through the linearised measurements, for what is to be added to the point, and back."""
        kinds, options = self.measurements.kinds, {**own_numbers(self.motion), "damping": damping}
        values: dict[str, Any] = {"x": point.first, **self.measurements.at(0), **self.prior, **options}
        earliest = self.compute(first_state(self.motion, kinds), values)
        # Where the information is not positive definite, it tells nothing.
        covariance = np.where(earliest["definite"], earliest["covariance"], np.nan)
        said = {**earliest, "x": point.first, "covariance": covariance}
        filter, passed = forth(self.motion, kinds), []
        for k, (dt, noise) in enumerate(zip(self.measurements.interval, point.noise, strict=True)):
            sums = {name: said[name] for name in ("x", "cost", "least", "mean", "covariance")}
            said = self.compute(filter, {**sums, **self.measurements.at(k + 1), "dt": dt, "noise": noise, **options})
            passed.append((said["added"], said["way"]))
        step, back = np.empty_like(point.noise), np.zeros_like(point.first)
        for k in reversed(range(len(passed))):
            added, way = passed[k]
            both = self.compute(BACK, {"back": back, "added": added, "way": way})["back"]
            back, step[k] = both[: len(back)], both[len(back) :]
        first = earliest["mean"] + linalg.apply(covariance, back)
        return About(said["cost"], said["least"], Unknowns(first, step), Gaussian(said["x"], said["covariance"]))

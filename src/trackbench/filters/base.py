"""Beliefs, and the filter interface: constant objects whose methods map a belief to a new one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter, methodcaller
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Indices, Mask, Scan, indices
from trackbench.base.units import difference
from trackbench.models.motion import MotionModel
from trackbench.models.sensors import SENSOR_MODELS


class Belief(NamedTuple):
    """Mean and covariance of the state in a filter, with values that the next step can reuse."""

    mean: Array
    """Mean ``(n, ...)`` of the state."""
    covariance: Array
    """Covariance ``(n, n, ...)`` of the state."""
    factor: Array | None = None
    """Lower Cholesky factor ``(n, n, ...)`` of the covariance; None where it was not computed."""
    points: Array | None = None
    """Sigma points ``(n, s, ...)`` of the predicted state; None for filters that use none."""
    repaired: Mask | None = None
    """Mask ``(...)``, True where the covariance was not positive definite and was repaired; None for nowhere."""


class MultiModelBelief(NamedTuple):
    """Distribution of the state in a filter with several motion models: a mixture of one belief per model."""

    probability: Array
    """Probability ``(M, ...)`` of each of the M motion models."""
    modes: tuple[Belief, ...]
    """Belief under each of the M motion models, in the state of that model."""
    repaired: Mask | None = None
    """Mask ``(...)``, True where a mode's covariance was not positive definite and was repaired; None for nowhere."""


#: Belief of any filter in a tracker.
AnyBelief = Belief | MultiModelBelief
B = TypeVar("B", bound=AnyBelief)


class Update(NamedTuple, Generic[B]):
    """Belief after the update with a measurement, with the innovation."""

    belief: B
    innovation: Array
    """Innovation ``(m, ...)``: measurement minus its prediction."""
    innovation_covariance: Array
    """Covariance ``(m, m, ...)`` of the innovation."""
    whitened_innovation: Array
    """Whitened innovation ``(m, ...)``, with unit covariance: ``L^-1 y`` where the innovation ``y`` has ``L L^T``."""
    innovation_factor: linalg.Cholesky | None = None
    """Cholesky factor of the innovation's covariance; None where it was not computed."""
    mixture: Array | None = None
    """Logarithm ``(...)`` of the measurement's density, if that density is a mixture of Gaussians; else None."""

    @property
    def log_likelihood(self) -> Array:
        """Logarithm ``(...)`` of the measurement's density: the Gaussian of the innovation, or the mixture."""
        if self.mixture is not None:
            return self.mixture
        factor = self.innovation_factor or linalg.cholesky(self.innovation_covariance)
        return factor.log_density(self.whitened_innovation)


class Step(NamedTuple, Generic[B]):
    """Belief after one prediction and one update with a scan."""

    update: Update[B]
    cartesian: Gaussian
    """Mean and covariance of px, py, vx, vy after the update."""
    refused: Mask | None = None
    """Mask ``(...)``, True where a check (the guard) refused the prediction, so that the step must not be used; None
    for nowhere."""


#: Function from a predicted belief to a mask that is True where the step is refused.
StepGuard = Callable[[Any], Mask]


class Measured(NamedTuple):
    """Measurements of a scan in the space in which a filter compares them with its predictions."""

    value: Array
    """Measured values ``(m, ...)``."""
    noise: Array
    """Covariance ``(m, m)`` of the measurement noise, or ``(m, m, ...)`` where it depends on the measurement."""
    angular: tuple[int, ...]
    """Indices of the measurement's components that are angles."""


class PredictedMeasurement(NamedTuple):
    """Mean and covariance of a predicted measurement, without its noise, and its covariance with the state."""

    mean: Array
    """Mean ``(m, ...)`` of the predicted measurement."""
    covariance: Array
    """Covariance ``(m, m, ...)`` of the predicted measurement, without the measurement noise."""
    cross: Array
    """Covariance ``(m, n, ...)`` of predicted measurement and state; ``n`` is 0 for a mixture of motion models."""
    modes: tuple[PredictedMeasurement, ...] = ()
    """Prediction under each motion model of a mixture; empty for a single model."""


class Filter(Protocol[B]):
    """Recursive Bayesian filter on beliefs with any batch axes."""

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """Motion models of the filter; one, or several for an IMM filter."""
        ...

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> B:
        """Return the first belief of a track; ``state_of`` returns the first state for a given motion model."""
        ...

    def predict(self, belief: B, dt: float) -> B:
        """Return the belief predicted ``dt`` seconds ahead (zero or more)."""
        ...

    def measured(self, scan: Scan) -> Measured:
        """Return the measurements of a scan in the space in which the filter compares them with its predictions."""
        ...

    def predict_measurement(self, belief: B, scan: Scan) -> PredictedMeasurement:
        """Return the prediction of a scan's measurement, made without the scan's measured values."""
        ...

    def update(self, belief: B, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[B]:
        """Return the belief updated with a scan; where the scan is not valid, mean and covariance stay.

        ``predicted`` is the result of ``predict_measurement`` for this belief, if there is one; it saves computing it
        anew.
        """
        ...

    def smooth(self, belief: B, later: B, dt: float) -> B:
        """Return the smoothed belief, given the smoothed belief ``dt`` seconds (more than zero) later."""
        ...

    def cartesian(self, belief: B) -> Gaussian:
        """Return mean and covariance of px, py, vx, vy under the belief."""
        ...


@dataclass(frozen=True)
class SingleModelFilter(Filter[Belief], ABC):
    """Filter with one motion model."""

    motion: MotionModel

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        return (self.motion,)

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> Belief:
        return Belief(*state_of(self.motion))

    def measured(self, scan: Scan) -> Measured:
        """Return the measurements as the sensor gives them, with the noise that is not part of the filter's state."""
        errors = self.motion.sensor_errors(scan)
        noise = scan.noise_covariance if errors is None else errors.noise
        return Measured(scan.measurement, noise, SENSOR_MODELS[scan.kind].angular)

    def smooth(self, belief: Belief, later: Belief, dt: float) -> Belief:
        """Return the smoothed belief by Rauch, Tung and Striebel.

        With ``D`` the covariance of the states at the start and the end of ``dt``, the prediction ``x^-, P^-`` and the
        gain ``G = D P^-^-1``: ``x <- x + G (x^s - x^-)`` and ``P <- P + G (P^s - P^-) G^T``. Source: Särkkä (2013),
        theorem 8.2 for the Kalman filter, algorithm 9.1 for linearised filters and 10.2 for sigma points.
        """
        angular, predicted = self.motion.angular, self.predict(belief, dt)
        definite = linalg.ensure_definite(predicted.covariance)
        # With P^- = L L^T and V = L^-1 D^T the gain is G = V^T L^-1.
        whiten = definite.factor.whiten
        gain = whiten(np.swapaxes(self.cross_covariance(belief, dt), 0, 1))
        change = whiten(difference(later.mean, predicted.mean, angular))
        mean = wrap_components(belief.mean + linalg.apply_transposed(gain, change), angular)
        loss = whiten(np.swapaxes(whiten(definite.covariance - later.covariance), 0, 1))
        covariance = belief.covariance - linalg.quadratic(np.swapaxes(gain, 0, 1), loss)
        result = linalg.ensure_definite(linalg.symmetrise(covariance))
        repaired = either(predicted.repaired, either(definite.repaired, result.repaired))
        return Belief(mean, result.covariance, repaired=repaired)

    def cartesian(self, belief: Belief) -> Gaussian:
        return self.motion.cartesian_belief(Gaussian(belief.mean, belief.covariance))

    @abstractmethod
    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        """Return the covariance ``(n, n, ...)`` between the states now (rows) and ``dt`` seconds later (columns)."""


#: Function from the transposed gain ``K^T`` ``(m, n, ...)`` to the updated covariance ``(n, n, ...)``.
Remainder = Callable[[Array], Array]


def correct(
    belief: Belief,
    innovation: Array,
    innovation_covariance: Array,
    cross: Array,
    valid: Mask,
    angular: tuple[int, ...],
    remainder: Remainder | None = None,
) -> Update[Belief]:
    """Update a belief with a measurement, by the linear minimum mean square error.

    With ``S = L L^T`` and ``W = L^-1 C`` the gain is ``K = W^T L^-1``. Without ``remainder``, ``W^T W`` is subtracted
    from the covariance, which is first rounded up in proportion to its size. After a measurement 1e7 times as accurate
    as the prediction, that rounding exceeds the true remainder. Source: Särkkä (2013), equations 4.21 to 4.24.

    Args:
        belief: predicted mean ``(n, ...)`` and covariance ``(n, n, ...)``.
        innovation: ``(m, ...)`` measurement minus its prediction.
        innovation_covariance: covariance ``S`` of the innovation, ``(m, m, ...)``.
        cross: covariance of measurement and state ``C``, ``(m, n, ...)``.
        valid: mask ``(...)``, True where there is a measurement.
        angular: indices of the state's components that are angles.
        remainder: function from ``K^T`` to the updated covariance; None to subtract ``W^T W``.
    """
    s = linalg.ensure_definite(innovation_covariance)
    whitened = s.factor.whiten(innovation)
    gain = s.factor.whiten(cross)
    mean = belief.mean + linalg.apply_transposed(gain, whitened)
    if remainder is None:
        covariance = linalg.rounded_up(belief.covariance) - linalg.gram(gain)
    else:
        covariance = remainder(s.factor.whiten_transposed(gain))
    if not np.all(valid):
        mean, covariance = np.where(valid, mean, belief.mean), np.where(valid, covariance, belief.covariance)
    repaired = either(belief.repaired, s.repaired)
    corrected = Belief(wrap_components(mean, angular), covariance, repaired=repaired)
    return Update(corrected, innovation, s.covariance, whitened, s.factor)


def linear_update(
    belief: Belief,
    predicted: PredictedMeasurement,
    measured: Measured,
    valid: Mask,
    angular: tuple[int, ...],
    remainder: Remainder | None = None,
) -> Update[Belief]:
    """Update a belief with a measurement and its prediction, by the linear minimum mean square error."""
    innovation = difference(measured.value, predicted.mean, measured.angular)
    s = predicted.covariance + linalg.expand(measured.noise, predicted.covariance)
    return correct(belief, innovation, s, predicted.cross, valid, angular, remainder)


def square_root(
    deviations: Array, seen: Array, noise: Array, weighted: Callable[[Array, Array], Array] = linalg.matmul_transposed
) -> Remainder:
    """Return a function that updates a covariance by its square root: ``(D - K Z) (D - K Z)^T + K R K^T``.

    This is Joseph's form, where ``D - K Z`` is ``(I - K H) L`` for a linear measurement. As a sum of squares it stays
    definite under rounding, however accurate the measurement is. Source: Bucy and Joseph (1968), "Filtering for
    stochastic processes with applications to guidance", section 16.2, with the covariance factored.

    Args:
        deviations: ``D``, ``(n, s, ...)`` deviations of the state, with the covariance ``D D^T``.
        seen: ``Z``, ``(m, s, ...)`` matching deviations of the measurement.
        noise: ``R``, covariance of the measurement noise, ``(m, m)`` or ``(m, m, ...)``.
        weighted: function for ``D D^T`` where deviations have weights.
    """

    def remainder(gain: Array) -> Array:
        left = deviations - linalg.transposed_matmul(gain, seen)
        covariance = weighted(left, left)
        covariance += linalg.gram(linalg.matmul(_root(noise), gain))
        return linalg.rounded_up(covariance)

    return remainder


def _root(noise: Array) -> Array:
    if isinstance(noise, np.ndarray) and noise.ndim == 2:
        return _cached_root(noise.astype(float).tobytes(), len(noise))
    return np.swapaxes(linalg.ensure_definite(linalg.rounded_up(noise)).factor.lower(), 0, 1)


@lru_cache(maxsize=256)
def _cached_root(noise: bytes, size: int) -> Array:
    whole = np.frombuffer(noise).reshape(size, size, 1)
    return np.ascontiguousarray(_root(whole)[..., 0])


def wrap_components(x: Array, angular: tuple[int, ...]) -> Array:
    """Return ``x`` with its angular components wrapped to (-pi, pi]."""
    return x if not angular else difference(x, np.zeros(()), angular)


def with_factor(belief: Belief) -> Belief:
    """Return the belief with its Cholesky factor; a covariance that has no factor is repaired and marked."""
    definite = linalg.ensure_definite(belief.covariance)
    return belief._replace(
        covariance=definite.covariance,
        factor=definite.factor.lower(),
        repaired=either(belief.repaired, definite.repaired),
    )


def either(a: Mask | None, b: Mask | None) -> Mask | None:
    """Return a mask that is True where at least one of two masks is; None stands for False everywhere."""
    if a is None or b is None:
        return b if a is None else a
    return a | b


def _map_arrays(function: Callable[..., Array], *beliefs: AnyBelief) -> AnyBelief:
    if isinstance(beliefs[0], Belief):
        return Belief(function(*map(_MEAN, beliefs)), function(*map(_COVARIANCE, beliefs)))
    modes = [_map_arrays(function, *each) for each in zip(*map(_MODES, beliefs), strict=True)]
    probability = function(*map(_PROBABILITY, beliefs))
    return MultiModelBelief(probability, tuple(mode for mode in modes if isinstance(mode, Belief)))


_MEAN, _COVARIANCE, _MODES, _PROBABILITY = map(attrgetter, ("mean", "covariance", "modes", "probability"))


def compact(belief: AnyBelief) -> AnyBelief:
    """Return the belief without its Cholesky factors and sigma points, which follow from means and covariances."""
    if isinstance(belief, Belief):
        return Belief(*belief[:2])
    return MultiModelBelief(belief.probability, tuple(Belief(*mode[:2]) for mode in belief.modes))


def select(belief: AnyBelief, which: Mask | Indices) -> AnyBelief:
    """Return the belief of the members that ``which``, a mask or indices, selects from the last batch axis."""
    index = indices(which) if which.dtype == bool else which
    # An index in brackets is slower, and leaves an array whose batch axis no longer comes last in memory.
    return _map_arrays(methodcaller("take", index, -1), belief)


def selected_prediction(predicted: PredictedMeasurement, which: Indices) -> PredictedMeasurement:
    """Return the predicted measurement of the members with the indices ``which`` on the last batch axis."""
    modes = tuple(selected_prediction(mode, which) for mode in predicted.modes)
    mean, covariance, cross = (part.take(which, axis=-1) for part in predicted[:3])
    return PredictedMeasurement(mean, covariance, cross, modes)


def concatenated(first: AnyBelief, second: AnyBelief) -> AnyBelief:
    """Join two beliefs of one filter along the last batch axis."""
    return _map_arrays(lambda *parts: np.concatenate(parts, axis=-1), first, second)


def with_members(belief: AnyBelief, where: Indices, members: AnyBelief) -> AnyBelief:
    """Return the belief with the members at the indices ``where`` of the last batch axis replaced by ``members``."""

    def put(values: Array, new_values: Array) -> Array:
        result = values.copy()
        result[..., where] = new_values
        return result

    return _map_arrays(put, belief, members)


def choose(where: Mask, a: AnyBelief, b: AnyBelief) -> AnyBelief:
    """Return a belief with ``a`` where the mask is True and ``b`` elsewhere; both are of one filter.

    Where ``b`` has no sigma points, the points of ``a`` are taken everywhere, as ``b`` is then a placeholder.
    """
    if isinstance(a, Belief):
        assert isinstance(b, Belief)
        return _choose_one(where, a, b)
    assert isinstance(b, MultiModelBelief)
    probability = np.where(where, a.probability, b.probability)
    modes = tuple(_choose_one(where, mode, other) for mode, other in zip(a.modes, b.modes, strict=True))
    return MultiModelBelief(probability, modes, _choose_marks(where, a.repaired, b.repaired))


def _choose_one(where: Mask, a: Belief, b: Belief) -> Belief:
    points = a.points if a.points is None or b.points is None else np.where(where, a.points, b.points)
    mean, covariance = np.where(where, a.mean, b.mean), np.where(where, a.covariance, b.covariance)
    return Belief(mean, covariance, points=points, repaired=_choose_marks(where, a.repaired, b.repaired))


def _choose_marks(where: Mask, a: Mask | None, b: Mask | None) -> Mask | None:
    return None if a is None and b is None else np.where(where, a is not None and a, b is not None and b)

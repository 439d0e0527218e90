"""What a filter is: an algorithm that never changes, through which a belief travels."""

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
    """What a filter believes of the state, with what it can reuse at its next step."""

    mean: Array
    """``(n, ...)``"""
    covariance: Array
    """``(n, n, ...)``"""
    factor: Array | None = None
    """``(n, n, ...)`` lower Cholesky factor of the covariance."""
    points: Array | None = None
    """``(n, s, ...)`` sigma points that a prediction has moved."""
    repaired: Mask | None = None
    """``(...)`` True where the covariance had to be made positive definite again."""


class MultiModelBelief(NamedTuple):
    """What a filter with several motion models believes: a mixture of what it believes under each."""

    probability: Array
    """``(M, ...)`` that the motion is that of each model."""
    modes: tuple[Belief, ...]
    """``(M,)`` under each model, in its state."""
    repaired: Mask | None = None
    """``(...)`` True where the covariance of a mode had to be made positive definite again."""


#: What the filters that trackers run believe.
AnyBelief = Belief | MultiModelBelief
B = TypeVar("B", bound=AnyBelief)


class Update(NamedTuple, Generic[B]):
    """A belief after a measurement, and what the measurement said."""

    belief: B
    innovation: Array
    """``(m, ...)`` measurement minus its prediction."""
    innovation_covariance: Array
    """``(m, m, ...)``"""
    whitened_innovation: Array
    """``(m, ...)`` innovation in units of its own standard deviations: ``L^-1 y`` with ``S = L L^T``."""
    innovation_factor: linalg.Cholesky | None = None
    """``L``, where it is at hand."""
    mixture: Array | None = None
    """``(...)`` logarithm of the density of the measurement, where it is that of a mixture."""

    @property
    def log_likelihood(self) -> Array:
        """``(...)`` logarithm of the density of the measurement: ``N(y; 0, S)``, or that of the mixture."""
        if self.mixture is not None:
            return self.mixture
        factor = self.innovation_factor or linalg.cholesky(self.innovation_covariance)
        return factor.log_density(self.whitened_innovation)


class Step(NamedTuple, Generic[B]):
    """What a filter makes of a scan that was taken some time after its belief."""

    update: Update[B]
    cartesian: Gaussian
    """px, py, vx, vy after it."""
    refused: Mask | None = None
    """``(...)`` where the prediction was refused by the guard, so that the step should not have been made."""


#: Tells of a predicted belief where the step is refused.
StepGuard = Callable[[Any], Mask]


class Measured(NamedTuple):
    """What a filter takes of a scan."""

    value: Array
    """``(m, ...)``"""
    noise: Array
    """``(m, m)``, or ``(m, m, ...)`` where it depends on the measurement."""
    angular: tuple[int, ...]
    """Which components are angles."""


class PredictedMeasurement(NamedTuple):
    """What a belief expects to be measured."""

    mean: Array
    """``(m, ...)``"""
    covariance: Array
    """``(m, m, ...)`` without the noise of the measurement."""
    cross: Array
    """``(m, n, ...)`` covariance of measurement and state; nothing of a mixture, whose modes have theirs."""
    modes: tuple[PredictedMeasurement, ...] = ()
    """Of a mixture, under each motion model."""


class Filter(Protocol[B]):
    """A recursive Bayesian filter on beliefs with any batch axes."""

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion models that it runs."""
        ...

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> B:
        """The belief of a track that starts; ``state_of`` says where, in the state of a motion model."""
        ...

    def predict(self, belief: B, dt: float) -> B:
        """The belief after ``dt`` seconds (zero or more)."""
        ...

    def measured(self, scan: Scan) -> Measured:
        """The measurements of a scan in the space in which the filter compares them with its predictions."""
        ...

    def predict_measurement(self, belief: B, scan: Scan) -> PredictedMeasurement:
        """What the belief expects of a scan, whose measurements are not looked at."""
        ...

    def update(self, belief: B, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[B]:
        """The belief after a scan; where the scan is not valid, the mean and covariance stay.

        ``predicted`` is what ``predict_measurement`` gave for this belief, which then need not be computed again.
        """
        ...

    def smooth(self, belief: B, later: B, dt: float) -> B:
        """The belief once it is known what is believed ``dt`` seconds (more than zero) later from more measurements."""
        ...

    def cartesian(self, belief: B) -> Gaussian:
        """px, py, vx, vy under the belief."""
        ...


@dataclass(frozen=True)
class SingleModelFilter(Filter[Belief], ABC):
    """A filter with one motion model."""

    motion: MotionModel

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion model."""
        return (self.motion,)

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> Belief:
        """The belief of a track that starts where ``state_of`` says."""
        return Belief(*state_of(self.motion))

    def measured(self, scan: Scan) -> Measured:
        """The measurements as the sensor gives them, with the noise beside what is part of the state."""
        errors = self.motion.sensor_errors(scan)
        noise = scan.noise_covariance if errors is None else errors.noise
        return Measured(scan.measurement, noise, SENSOR_MODELS[scan.kind].angular)

    def smooth(self, belief: Belief, later: Belief, dt: float) -> Belief:
        """The belief once it is known what is believed ``dt`` seconds later, by Rauch, Tung and Striebel.

        With ``D`` the covariance of the states before and after the interval, the prediction ``x^-, P^-`` and the gain
        ``G = D P^-^-1``: ``x <- x + G (x^s - x^-)`` and ``P <- P + G (P^s - P^-) G^T``. Source: Särkkä (2013), theorem
        8.2 for the Kalman filter, algorithm 9.1 for its linearisations and 10.2 for the sigma points.
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
        """px, py, vx, vy under the belief."""
        return self.motion.cartesian_belief(Gaussian(belief.mean, belief.covariance))

    @abstractmethod
    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        """``(n, n, ...)`` covariance of the state before (rows) and after (columns) ``dt`` seconds."""


#: What remains of a covariance ``(n, n, ...)``, from the transposed gain ``K^T`` ``(m, n, ...)``.
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
    """The linear minimum mean square error update.

    With ``S = L L^T`` and ``W = L^-1 C`` the gain is ``K = W^T L^-1``. Unless ``remainder`` says what remains of the
    covariance, it loses ``W^T W`` and is rounded up by a share of what it was: that is more than what remains after a
    measurement that is 1e7 times as accurate as the prediction. Source: Särkkä (2013), equations 4.21 to 4.24.

    Args:
        belief: predicted mean ``(n, ...)`` and covariance ``(n, n, ...)``.
        innovation: ``(m, ...)``.
        innovation_covariance: ``S``, ``(m, m, ...)``.
        cross: covariance of measurement and state ``C``, ``(m, n, ...)``.
        valid: ``(...)`` where there is a measurement.
        angular: which components of the state are angles.
        remainder: of the covariance of the belief.
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
    """The linear update with a measurement and its prediction; the rest as ``correct`` has it."""
    innovation = difference(measured.value, predicted.mean, measured.angular)
    s = predicted.covariance + linalg.expand(measured.noise, predicted.covariance)
    return correct(belief, innovation, s, predicted.cross, valid, angular, remainder)


def square_root(
    deviations: Array, seen: Array, noise: Array, weighted: Callable[[Array, Array], Array] = linalg.matmul_transposed
) -> Remainder:
    """What remains of a covariance by its square root: ``(D - K Z) (D - K Z)^T + K R K^T``.

    It is Joseph's form, ``D - K Z`` being ``(I - K H) L`` where the measurement is linear, but a sum of squares, which
    rounding leaves definite however accurate the measurement is. Source: Bucy and Joseph (1968), "Filtering for
    stochastic processes with applications to guidance", section 16.2, with the covariance factored.

    Args:
        deviations: ``D``, ``(n, s, ...)`` of the state, with the covariance ``D D^T``.
        seen: ``Z``, ``(m, s, ...)`` of the measurement.
        noise: ``R``, ``(m, m)`` or ``(m, m, ...)``.
        weighted: what ``D D^T`` is, where deviations have weights.
    """

    def remainder(gain: Array) -> Array:
        left = deviations - linalg.transposed_matmul(gain, seen)
        covariance = weighted(left, left)
        covariance += linalg.gram(linalg.matmul(_root(noise), gain))
        return linalg.rounded_up(covariance)

    return remainder


def _root(noise: Array) -> Array:
    """``A`` with ``A^T A = R``, of a noise that is singular to rounding too."""
    if isinstance(noise, np.ndarray) and noise.ndim == 2:
        return _root_of_sensor(noise.astype(float).tobytes(), len(noise))
    return np.swapaxes(linalg.ensure_definite(linalg.rounded_up(noise)).factor.lower(), 0, 1)


@lru_cache(maxsize=256)
def _root_of_sensor(noise: bytes, size: int) -> Array:
    """The same of a noise that is the same for the whole batch, which a sensor has in all its scans."""
    whole = np.frombuffer(noise).reshape(size, size, 1)
    return np.ascontiguousarray(_root(whole)[..., 0])


def wrap_components(x: Array, angular: tuple[int, ...]) -> Array:
    """``x`` with its angular components in (-pi, pi]."""
    return x if not angular else difference(x, np.zeros(()), angular)


def guarded(belief: Belief) -> Belief:
    """The belief with its factor, and its covariance repaired (and marked) where it was not positive definite."""
    definite = linalg.ensure_definite(belief.covariance)
    return belief._replace(
        covariance=definite.covariance,
        factor=definite.factor.lower(),
        repaired=either(belief.repaired, definite.repaired),
    )


def either(a: Mask | None, b: Mask | None) -> Mask | None:
    """Where one of two marks is set."""
    if a is None or b is None:
        return b if a is None else a
    return a | b


def _mapped_belief(function: Callable[..., Array], *beliefs: AnyBelief) -> AnyBelief:
    """What a function makes of the mean, of the covariance and of the mode probabilities of beliefs of one filter.

    What a filter could reuse is left out.
    """
    if isinstance(beliefs[0], Belief):
        return Belief(function(*map(_MEAN, beliefs)), function(*map(_COVARIANCE, beliefs)))
    modes = [_mapped_belief(function, *each) for each in zip(*map(_MODES, beliefs), strict=True)]
    probability = function(*map(_PROBABILITY, beliefs))
    return MultiModelBelief(probability, tuple(mode for mode in modes if isinstance(mode, Belief)))


_MEAN, _COVARIANCE, _MODES, _PROBABILITY = map(attrgetter, ("mean", "covariance", "modes", "probability"))


def bare(belief: AnyBelief) -> AnyBelief:
    """Without what it can be computed from."""
    if isinstance(belief, Belief):
        return Belief(*belief[:2])
    return MultiModelBelief(belief.probability, tuple(Belief(*mode[:2]) for mode in belief.modes))


def select(belief: AnyBelief, which: Mask | Indices) -> AnyBelief:
    """Some members of the last batch axis."""
    index = indices(which) if which.dtype == bool else which
    # An index in brackets is slower, and leaves an array whose batch axis no longer comes last in memory.
    return _mapped_belief(methodcaller("take", index, -1), belief)


def selected_prediction(predicted: PredictedMeasurement, which: Indices) -> PredictedMeasurement:
    """The same of a predicted measurement."""
    modes = tuple(selected_prediction(mode, which) for mode in predicted.modes)
    mean, covariance, cross = (part.take(which, axis=-1) for part in predicted[:3])
    return PredictedMeasurement(mean, covariance, cross, modes)


def concatenated(first: AnyBelief, second: AnyBelief) -> AnyBelief:
    """Along the last batch axis."""
    return _mapped_belief(lambda *parts: np.concatenate(parts, axis=-1), first, second)


def with_members(belief: AnyBelief, where: Indices, members: AnyBelief) -> AnyBelief:
    """The belief with some members of the last batch axis in place of its own."""

    def put(values: Array, others: Array) -> Array:
        result = values.copy()
        result[..., where] = others
        return result

    return _mapped_belief(put, belief, members)


def choose(where: Mask, a: AnyBelief, b: AnyBelief) -> AnyBelief:
    """``a`` where it holds, ``b`` elsewhere; both are of the same filter.

    Sigma points are kept if ``a`` has them; if ``b`` has none, it is a placeholder whose points do not count.
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

"""The interacting multiple model filter and its smoother."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Indices, Mask, Scan
from trackbench.base.units import cos_sin, difference, wrap_angle
from trackbench.filters.base import (
    Belief,
    Filter,
    Measured,
    MultiModelBelief,
    PredictedMeasurement,
    SingleModelFilter,
    Update,
    either,
    wrap_components,
)
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
        # What is small beside the other part would be lost in a difference of both.
        joined = (1.0 - share) * covariance
        joined += share * part.covariance
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
    mean[places] = linalg.matvec(slope, cartesian.mean)
    mean[yaw] = own.mean[yaw]
    covariance[np.ix_(places, places)] = linalg.rounded_up(linalg.quadratic(slope, cartesian.covariance))
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


#: What differs by no more is the same, relative to the variances before.
ROUNDING = 1e-9


class Future(NamedTuple):
    """The likelihood of a state under measurements to come: the ratio of two Gaussians, before and after them.

    In coordinates ``u`` with ``x = mean + L u``, in which the Gaussian before is standard normal, it is proportional to
    ``exp(-u^T J u / 2 + h^T u)``.
    """

    mean: Array
    """``(n, ...)``"""
    factor: linalg.Cholesky
    """``L``"""
    information: Array
    """``J``, ``(n, n, ...)``"""
    gradient: Array
    """``h``, ``(n, ...)``"""
    angular: tuple[int, ...]
    """Which components are angles."""

    def joined(self, part: Gaussian) -> tuple[Gaussian, Array, Mask | None]:
        """A Gaussian given those measurements, the logarithm of its likelihood, and where it had to be repaired.

        The likelihoods of several parts have a common factor.
        """
        whiten = self.factor.whiten
        away = whiten(difference(part.mean, self.mean, self.angular))
        spread = linalg.ensure_definite(whiten(np.swapaxes(whiten(part.covariance), 0, 1)))
        # With A = B B^T and M = 1 + B^T J B the covariance A^-1 + J is inverted by B M^-1 B^T.
        root = spread.factor.lower()
        size = len(root)
        scaled = linalg.matmul(np.swapaxes(root, 0, 1), linalg.matmul(self.information, root))
        m = linalg.ensure_definite(linalg.symmetrise(scaled) + linalg.expand(np.eye(size), scaled))
        after = m.factor.whiten(np.swapaxes(root, 0, 1))
        slope = self.gradient - linalg.matvec(self.information, away)
        step = linalg.matvec(after, slope)
        logarithm = np.einsum("i...,i...->...", self.gradient + slope, away) + np.einsum("i...,i...->...", step, step)
        determinant = np.log(np.prod(np.stack(m.factor.inverse_diagonal), axis=0))
        lower = self.factor.lower()
        mean = self.mean + linalg.matvec(lower, away + linalg.apply_transposed(after, step))
        covariance = linalg.gram(linalg.matmul_transposed(after, lower))
        return Gaussian(wrap_components(mean, self.angular), covariance), 0.5 * logarithm + determinant, m.repaired


def _future(before: Gaussian, after: Gaussian, angular: tuple[int, ...]) -> Future:
    """What made ``after``, a smoothed belief, of ``before``.

    Where ``before`` stands for several Gaussians, ``after`` may be wider in some direction; of that it says nothing.
    """
    factor = linalg.ensure_definite(before.covariance).factor
    spread = linalg.symmetrise(factor.whiten(np.swapaxes(factor.whiten(after.covariance), 0, 1)))
    change = factor.whiten(difference(after.mean, before.mean, angular))
    unit = np.broadcast_to(linalg.expand(np.eye(len(change)), spread), spread.shape)
    inverse = linalg.gram(linalg.cholesky(spread).whiten(unit))
    information, gradient = inverse - unit, linalg.matvec(inverse, change)
    # What overflows is wider.
    with np.errstate(over="ignore", invalid="ignore"):
        wider = ~linalg.cholesky((1.0 + ROUNDING) * unit - spread).positive
    if np.any(wider):
        values, vectors = np.linalg.eigh(np.moveaxis(spread[..., wider], -1, 0))
        inverses = np.where(values < 1.0, 1.0 / np.maximum(values, ROUNDING), 0.0)[:, None]
        across = np.swapaxes(vectors, 1, 2)
        information[..., wider] = np.moveaxis(vectors * np.maximum(inverses - 1.0, 0.0) @ across, 0, -1)
        gradient[..., wider] = linalg.matvec(np.moveaxis(vectors * inverses @ across, 0, -1), change[..., wider])
    return Future(before.mean, factor, information, gradient, angular)


#: The least probability of a mode: one that underflowed to zero could never come back where modes do not switch.
LEAST = 1e-300


@lru_cache(maxsize=256)
def transition_probabilities(stay_s: tuple[float, ...], dt: float) -> Array:
    """``(M, M)`` probability that the motion is that of model j (column) ``dt`` seconds after it was that of i (row).

    A Markov chain in continuous time: the motion stays with model i for an exponentially distributed time of mean
    ``stay_s[i]``, and then goes over to any of the others alike. So the chain does not depend on the rate of scans.
    """
    size, stay = len(stay_s), np.sqrt(stay_s)
    if dt == 0.0:
        return np.eye(size)
    # With rates 1 / ((M - 1) stay_s[i]) the chain is reversible: scaled by the stays, the rate matrix is symmetric.
    rates = (np.ones((size, size)) - size * np.eye(size)) / (size - 1)
    values, vectors = np.linalg.eigh(rates / np.outer(stay, stay))
    scaled = (vectors * np.exp(values * dt)) @ vectors.T
    return np.asarray(np.clip(scaled * stay / stay[:, None], 0.0, 1.0))


@dataclass(frozen=True)
class InteractingMultipleModel(Filter[MultiModelBelief]):
    """The IMM estimator over filters of the same kind with different motion models, whose states may differ in size.

    Source: Blom and Bar-Shalom (1988); Bar-Shalom, Li and Kirubarajan (2001), section 11.6.6.
    """

    filters: tuple[SingleModelFilter, ...]
    stay_s: tuple[float, ...]
    """Mean time for which the motion stays with each model, s; each may be ``(batch,)``."""
    initial_probabilities: tuple[float, ...]

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion models, one for each mode."""
        return tuple(filter.motion for filter in self.filters)

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> MultiModelBelief:
        """The belief of a track that starts where ``state_of`` says, in the state of each motion model."""
        modes = tuple(filter.begin(state_of) for filter in self.filters)
        batch = modes[0].mean.shape[1:]
        probability = linalg.expand(linalg.vector(self.initial_probabilities), modes[0].mean)
        return MultiModelBelief(np.broadcast_to(probability, (len(modes), *batch)), modes)

    def predict(self, belief: MultiModelBelief, dt: float) -> MultiModelBelief:
        """Mix the modes by the Markov chain, and predict each."""
        # Where no time passes, to mix them would change nothing and cost more than the rest.
        return self.predict_by(belief, dt, self.chain(dt)) if dt > 0.0 else self._predicted(belief, dt)

    def predict_by(self, belief: MultiModelBelief, dt: float, chain: Array) -> MultiModelBelief:
        """The same, with the ``chain`` of ``dt``."""
        return self._predicted(self._mixed(belief, chain), dt)

    def _predicted(self, belief: MultiModelBelief, dt: float) -> MultiModelBelief:
        modes = [filter.predict(mode, dt) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return _joined_modes(belief.probability, modes, belief.repaired)

    def measured(self, scan: Scan) -> Measured:
        """The measurements of a scan in the space in which the filters compare them with their predictions."""
        return self.filters[0].measured(scan)

    def predict_measurement(self, belief: MultiModelBelief, scan: Scan) -> PredictedMeasurement:
        """What the mixture expects of a scan, with what each mode expects."""
        pairs = zip(self.filters, belief.modes, strict=True)
        modes = tuple(filter.predict_measurement(mode, scan) for filter, mode in pairs)
        parts = [Gaussian(mode.mean, mode.covariance) for mode in modes]
        mean, covariance = moment_matched(belief.probability, parts, self.measured(scan).angular)
        return PredictedMeasurement(mean, covariance, np.empty((len(mean), 0, *mean.shape[1:])), modes)

    def update(
        self, belief: MultiModelBelief, scan: Scan, predicted: PredictedMeasurement | None = None
    ) -> Update[MultiModelBelief]:
        """Update each mode, and weigh it by the likelihood of the measurement.

        The innovation and its covariance are those of the mixture of what the modes predicted; the innovation is 0
        where the scan is not valid.
        """
        expected = predicted.modes if predicted is not None else (None,) * len(self.filters)
        updates = [
            filter.update(mode, scan, each)
            for filter, mode, each in zip(self.filters, belief.modes, expected, strict=True)
        ]
        log_likelihood = np.stack([update.log_likelihood for update in updates])
        parts = [Gaussian(update.innovation, update.innovation_covariance) for update in updates]
        if not np.all(scan.valid):
            log_likelihood = np.where(scan.valid, log_likelihood, 0.0)
            parts = [Gaussian(np.where(scan.valid, mean, 0.0), covariance) for mean, covariance in parts]
        probability, mixture = normalised(np.log(belief.probability) + log_likelihood)
        after = _joined_modes(probability, [update.belief for update in updates], belief.repaired)
        innovation, covariance = moment_matched(belief.probability, parts, self.measured(scan).angular)
        s = linalg.ensure_definite(covariance)
        return Update(after, innovation, s.covariance, s.factor.whiten(innovation), s.factor, mixture)

    def smooth(self, belief: MultiModelBelief, later: MultiModelBelief, dt: float) -> MultiModelBelief:
        """The belief once it is known what is believed ``dt`` seconds later.

        For each mode after the interval the mixture from which it was predicted is smoothed by the mode's filter, and
        what that says of the mixture is applied to each of its parts. Source: a backward recursion on what an IMM
        filter leaves, with one smoother for each mode, as that of Lopez and Danès (2017), "Low-complexity IMM smoothing
        for jump Markov nonlinear systems"; here the measurements to come enter as a ratio of two Gaussians.
        """
        chain = self.chain(dt)
        size = len(self.filters)
        joint = np.zeros((size, *later.probability.shape))
        parts: list[list[Gaussian]] = [[] for _ in self.filters]
        repaired: Mask | None = None
        for j, motion in enumerate(self.motions):
            come, before = self.mixture(belief, chain, j)
            mixed = moment_matched(come, before, motion.angular)
            after = self.filters[j].smooth(Belief(*mixed), later.modes[j], dt)
            evidence = _future(mixed, Gaussian(after.mean, after.covariance), motion.angular)
            result = [evidence.joined(part) for part in before]
            share, _ = normalised(np.log(come) + np.stack([likelihood for _, likelihood, _ in result]))
            for k, i in enumerate(self.origins(j)):
                joint[i, j] = share[k] * later.probability[j]
                parts[i].append(result[k][0])
                repaired = either(repaired, result[k][2])
            repaired = either(repaired, after.repaired)
        joint = np.maximum(joint, LEAST)
        probability = joint.sum(axis=1)
        modes = [self._parted(belief, i, joint[i] / probability[i], parts[i]) for i in range(size)]
        return _joined_modes(probability / probability.sum(axis=0), modes, repaired)

    def _parted(self, belief: MultiModelBelief, mode: int, weights: Array, parts: Sequence[Gaussian]) -> Belief:
        """A mode before an interval, of the parts that go over to each mode, which are in the states of these."""
        motion, own = self.motions[mode], Gaussian(belief.modes[mode].mean, belief.modes[mode].covariance)
        here, *others = self.origins(mode)
        others_here = [in_state_of(motion, own, self.motions[j], parts[j]) for j in others]
        return Belief(*moment_matched(weights[[here, *others]], [parts[here], *others_here], motion.angular))

    def cartesian(self, belief: MultiModelBelief) -> Gaussian:
        """Mean and covariance of px, py, vx, vy under the mixture of the modes."""
        parts = [filter.cartesian(mode) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return moment_matched(belief.probability, parts, ())

    def chain(self, dt: float) -> Array:
        """``(M, M)``, or ``(M, M, batch)`` where each of a batch has its own, as ``transition_probabilities``."""
        distinct, place = self._stays
        chains = [transition_probabilities(tuple(stay), dt) for stay in distinct]
        return chains[0] if place.ndim == 0 else np.stack(chains, axis=-1)[..., place]

    @cached_property
    def _stays(self) -> tuple[list[list[float]], Indices]:
        """The different mean times of a batch, and which of them each of it has."""
        stay = linalg.vector(self.stay_s)
        distinct, place = np.unique(stay.reshape(len(stay), -1), axis=1, return_inverse=True)
        return distinct.T.tolist(), place.reshape(stay.shape[1:])

    def _mixed(self, belief: MultiModelBelief, chain: Array) -> MultiModelBelief:
        """What each mode starts its prediction from: the modes that may have gone over to it, by their probability."""
        modes = []
        for j, motion in enumerate(self.motions):
            come, parts = self.mixture(belief, chain, j)
            modes.append(Belief(*moment_matched(come, parts, motion.angular)))
        probability = np.einsum("i...,ij...->j...", belief.probability, chain)
        return MultiModelBelief(probability, tuple(modes), belief.repaired)

    def mixture(self, belief: MultiModelBelief, chain: Array, to: int) -> tuple[Array, list[Gaussian]]:
        """The modes before a transition to the mode ``to``: their probabilities ``(M, ...)``, and each in its state.

        In the order of ``origins``.
        """
        modes = [Gaussian(mode.mean, mode.covariance) for mode in belief.modes]
        own, *others = self.origins(to)
        come = np.stack([chain[i, to] * belief.probability[i] for i in (own, *others)])
        parts = [in_state_of(self.motions[to], modes[to], self.motions[i], modes[i]) for i in others]
        return come / come.sum(axis=0), [modes[to], *parts]

    def origins(self, to: int) -> list[int]:
        """The modes from which a transition to a mode may come: that one first, whose probability is not zero."""
        return [to, *(i for i in range(len(self.filters)) if i != to)]


def _joined_modes(probability: Array, modes: Sequence[Belief], repaired: Mask | None) -> MultiModelBelief:
    """The modes as one belief, which has the marks of theirs."""
    for mode in modes:
        repaired = either(repaired, mode.repaired)
    return MultiModelBelief(probability, tuple(mode._replace(repaired=None) for mode in modes), repaired)


def normalised(logarithm: Array) -> tuple[Array, Array]:
    """Probabilities ``(M, ...)`` of logarithms that may lack a common term, and the logarithm ``(...)`` of the sum."""
    largest = logarithm.max(axis=0)
    weights = np.maximum(np.exp(logarithm - largest), LEAST)
    total = weights.sum(axis=0)
    return weights / total, largest + np.log(total)

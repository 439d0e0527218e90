"""Interacting multiple model (IMM) filter and its smoother."""

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

#: Components that position and velocity determine.
DETERMINED = {*POSITION, *VELOCITY, *YAW}
#: Components that change their sign where the yaw is turned by 180 degrees and the motion stays.
ALONG_PATH = ("v", "a")


def moment_matched(weights: Array | Sequence[Array], parts: Sequence[Gaussian], angular: tuple[int, ...]) -> Gaussian:
    """Return mean and covariance of a mixture of Gaussians, computed by merging its components one by one.

    Source: Bar-Shalom, Li and Kirubarajan (2001), section 1.4.16.

    Args:
        weights: probability ``(...)`` of each component of the mixture; the first is positive, and their sum is one.
        parts: components of the mixture, each with mean ``(n, ...)``.
        angular: indices of the components that are angles.
    """
    (mean, covariance), total = parts[0], weights[0]
    for weight, part in zip(weights[1:], parts[1:], strict=True):
        total = total + weight
        share = weight / total
        away = difference(part.mean, mean, angular)
        spread = np.sqrt(share * (1.0 - share)) * away
        # A sum keeps a small part, which a difference of large terms would lose.
        joined = (1.0 - share) * covariance
        joined += share * part.covariance
        joined += spread[:, None] * spread
        mean, covariance = wrap_components(mean + share * away, angular), joined
    return Gaussian(mean, covariance)


def in_state_of(motion: MotionModel, current: Gaussian, source_motion: MotionModel, source: Gaussian) -> Gaussian:
    """Convert the belief ``source`` of another model's filter to the state of ``motion``.

    Components that both states have are copied. Where one state has vx, vy and the other a speed and a yaw, position
    and velocity are converted through px, py, vx, vy, to first order. A component that the other model lacks gets the
    mean and the variance of ``current``, the belief of the filter of ``motion``: mixing then leaves that component
    unchanged, where a zero would bias it. The yaw, too, gets mean and variance of ``current`` where the velocity does
    not determine the yaw. Source: Yuan et al. (2012), "A multiple IMM estimation approach with unbiased mixing for
    thrusting projectiles"; Granström, Willett and Bar-Shalom (2015), "Systematic approach to IMM mixing for unequal
    dimension states".
    """
    names, seen = motion.components, source_motion.components
    if {*names} & {*VELOCITY, *YAW} != {*seen} & {*VELOCITY, *YAW}:
        cartesian = source_motion.cartesian_belief(source)
        # Only the components that position and velocity determine are used below.
        source = motion.from_cartesian(cartesian, InitialSigmas(1.0, 1.0))
        seen = tuple(name if name in DETERMINED else "" for name in names)
        if "v" in names and "yaw" in names:
            source = _fill_unknown_yaw(current, names, source, cartesian)
    if "v" in names and "yaw" in names:
        source = _face(current.mean[names.index("yaw")], seen, source)
    if names == seen:
        return source
    shared = [name for name in names if name in seen]
    to, origin = [names.index(name) for name in shared], [seen.index(name) for name in shared]
    lacking = [i for i in range(len(names)) if i not in to]
    mean, covariance = current.mean.copy(), np.zeros_like(current.covariance)
    mean[to] = source.mean[origin]
    covariance[np.ix_(to, to)] = source.covariance[np.ix_(origin, origin)]
    covariance[np.ix_(lacking, lacking)] = current.covariance[np.ix_(lacking, lacking)]
    return Gaussian(mean, covariance)


def _fill_unknown_yaw(current: Gaussian, names: tuple[str, ...], source: Gaussian, cartesian: Gaussian) -> Gaussian:
    """Replace yaw, and speed along it, by ``current`` where the velocity of ``source`` does not determine the yaw."""
    places = [names.index(name) for name in ("px", "py", "v")]
    yaw = names.index("yaw")
    unknown = source.covariance[yaw, yaw] > 0.999 * UNKNOWN_ANGLE**2
    if not np.any(unknown):
        return source
    c, s = cos_sin(current.mean[yaw])
    slope = linalg.matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]])
    mean, covariance = source.mean.copy(), np.zeros_like(source.covariance)
    mean[places] = linalg.matvec(slope, cartesian.mean)
    mean[yaw] = current.mean[yaw]
    covariance[np.ix_(places, places)] = linalg.rounded_up(linalg.quadratic(slope, cartesian.covariance))
    covariance[yaw, yaw] = current.covariance[yaw, yaw]
    return Gaussian(mean, covariance).where(unknown, source)


def _face(yaw: Array, names: tuple[str, ...], belief: Gaussian) -> Gaussian:
    """Turn the yaw to within 90 degrees of ``yaw``; an opposite yaw with an opposite speed is the same motion."""
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


#: Largest difference that counts as rounding, relative to the variances before.
ROUNDING = 1e-9


class LaterLikelihood(NamedTuple):
    """Likelihood of a state under later measurements: the ratio of its smoothed and its predicted Gaussian.

    In coordinates ``u`` with ``x = mean + L u`` the predicted Gaussian is standard normal, and the likelihood is
    proportional to ``exp(-u^T J u / 2 + h^T u)``.
    """

    mean: Array
    """Mean ``(n, ...)`` of the predicted Gaussian."""
    factor: linalg.Cholesky
    """Cholesky factor ``L`` of the predicted covariance."""
    information: Array
    """Matrix ``J``, ``(n, n, ...)``, of the quadratic term."""
    gradient: Array
    """Vector ``h``, ``(n, ...)``, of the linear term."""
    angular: tuple[int, ...]
    """Indices of the state's components that are angles."""

    def condition(self, part: Gaussian) -> tuple[Gaussian, Array, Mask | None]:
        """Condition a Gaussian on the later measurements; return it with its log-likelihood and a mask of repairs.

        The mask is None if no covariance was repaired. The log-likelihoods of several Gaussians have a common offset.
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


def _later_likelihood(before: Gaussian, after: Gaussian, angular: tuple[int, ...]) -> LaterLikelihood:
    """Return the likelihood that turns the predicted ``before`` into the smoothed ``after``.

    Where ``before`` stands for a mixture, ``after`` may be wider in some direction; the likelihood is constant along
    it.
    """
    factor = linalg.ensure_definite(before.covariance).factor
    spread = linalg.symmetrise(factor.whiten(np.swapaxes(factor.whiten(after.covariance), 0, 1)))
    change = factor.whiten(difference(after.mean, before.mean, angular))
    unit = np.broadcast_to(linalg.expand(np.eye(len(change)), spread), spread.shape)
    inverse = linalg.gram(linalg.cholesky(spread).whiten(unit))
    information, gradient = inverse - unit, linalg.matvec(inverse, change)
    # Overflow counts as wider.
    with np.errstate(over="ignore", invalid="ignore"):
        wider = ~linalg.cholesky((1.0 + ROUNDING) * unit - spread).positive
    if np.any(wider):
        values, vectors = np.linalg.eigh(np.moveaxis(spread[..., wider], -1, 0))
        inverses = np.where(values < 1.0, 1.0 / np.maximum(values, ROUNDING), 0.0)[:, None]
        across = np.swapaxes(vectors, 1, 2)
        information[..., wider] = np.moveaxis(vectors * np.maximum(inverses - 1.0, 0.0) @ across, 0, -1)
        gradient[..., wider] = linalg.matvec(np.moveaxis(vectors * inverses @ across, 0, -1), change[..., wider])
    return LaterLikelihood(before.mean, factor, information, gradient, angular)


#: Least probability of a mode: without switching, a mode of probability zero would never return.
LEAST_PROBABILITY = 1e-300


@lru_cache(maxsize=256)
def transition_probabilities(stay_s: tuple[float, ...], dt: float) -> Array:
    """Return ``(M, M)`` probabilities that the mode is j (column) ``dt`` seconds after it was i (row).

    The modes are a Markov chain in continuous time: the motion stays with mode i for an exponentially distributed time
    of mean ``stay_s[i]``, and then changes to one of the other modes with equal probability. So the chain does not
    depend on the rate of scans.
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
    """IMM estimator that runs filters of one type with different motion models, whose states can differ in size.

    Source: Blom and Bar-Shalom (1988); Bar-Shalom, Li and Kirubarajan (2001), section 11.6.6.
    """

    filters: tuple[SingleModelFilter, ...]
    stay_s: tuple[float, ...]
    """Mean time for which the motion stays with each mode, s; each is a number, or ``(batch,)`` for the members."""
    initial_probabilities: tuple[float, ...]

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        return tuple(filter.motion for filter in self.filters)

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> MultiModelBelief:
        modes = tuple(filter.begin(state_of) for filter in self.filters)
        batch = modes[0].mean.shape[1:]
        probability = linalg.expand(linalg.vector(self.initial_probabilities), modes[0].mean)
        return MultiModelBelief(np.broadcast_to(probability, (len(modes), *batch)), modes)

    def predict(self, belief: MultiModelBelief, dt: float) -> MultiModelBelief:
        """Predict the belief ``dt`` seconds ahead: mix the modes by the Markov chain, then predict each mode."""
        # With no time passed, mixing would change nothing and cost more than the prediction.
        return self.predict_by(belief, dt, self.chain(dt)) if dt > 0.0 else self._predict_modes(belief, dt)

    def predict_by(self, belief: MultiModelBelief, dt: float, chain: Array) -> MultiModelBelief:
        """Predict the belief like ``predict``, with the transition probabilities ``chain`` over ``dt`` given."""
        return self._predict_modes(self._mix_modes(belief, chain), dt)

    def _predict_modes(self, belief: MultiModelBelief, dt: float) -> MultiModelBelief:
        modes = [filter.predict(mode, dt) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return _combine_modes(belief.probability, modes, belief.repaired)

    def measured(self, scan: Scan) -> Measured:
        return self.filters[0].measured(scan)

    def predict_measurement(self, belief: MultiModelBelief, scan: Scan) -> PredictedMeasurement:
        """Return the predicted measurement of the mixture of the modes, and of each mode."""
        pairs = zip(self.filters, belief.modes, strict=True)
        modes = tuple(filter.predict_measurement(mode, scan) for filter, mode in pairs)
        parts = [Gaussian(mode.mean, mode.covariance) for mode in modes]
        mean, covariance = moment_matched(belief.probability, parts, self.measured(scan).angular)
        return PredictedMeasurement(mean, covariance, np.empty((len(mean), 0, *mean.shape[1:])), modes)

    def update(
        self, belief: MultiModelBelief, scan: Scan, predicted: PredictedMeasurement | None = None
    ) -> Update[MultiModelBelief]:
        """Update each mode, and its probability by the likelihood of the measurement.

        The innovation and its covariance are moments of the mixture of the modes' predictions; the innovation is 0
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
        after = _combine_modes(probability, [update.belief for update in updates], belief.repaired)
        innovation, covariance = moment_matched(belief.probability, parts, self.measured(scan).angular)
        s = linalg.ensure_definite(covariance)
        return Update(after, innovation, s.covariance, s.factor.whiten(innovation), s.factor, mixture)

    def smooth(self, belief: MultiModelBelief, later: MultiModelBelief, dt: float) -> MultiModelBelief:
        """Return the smoothed belief, given the smoothed belief ``dt`` seconds later.

        Each mode at the later time was predicted from a mixture, which the mode's filter smooths. The ratio of the
        smoothed and the unsmoothed Gaussian is the likelihood of the later measurements. Each Gaussian of the mixture
        is conditioned on it. Source: a backward recursion on the output of an IMM filter, with one smoother for each
        mode, like Lopez and Danès (2017), "Low-complexity IMM smoothing for jump Markov nonlinear systems".
        """
        chain = self.chain(dt)
        size = len(self.filters)
        joint = np.zeros((size, *later.probability.shape))
        parts: list[list[Gaussian]] = [[] for _ in self.filters]
        repaired: Mask | None = None
        for j, motion in enumerate(self.motions):
            weights, before = self.mixture(belief, chain, j)
            mixed = moment_matched(weights, before, motion.angular)
            after = self.filters[j].smooth(Belief(*mixed), later.modes[j], dt)
            evidence = _later_likelihood(mixed, Gaussian(after.mean, after.covariance), motion.angular)
            result = [evidence.condition(part) for part in before]
            share, _ = normalised(np.log(weights) + np.stack([likelihood for _, likelihood, _ in result]))
            for k, i in enumerate(self.origins(j)):
                joint[i, j] = share[k] * later.probability[j]
                parts[i].append(result[k][0])
                repaired = either(repaired, result[k][2])
            repaired = either(repaired, after.repaired)
        joint = np.maximum(joint, LEAST_PROBABILITY)
        probability = joint.sum(axis=1)
        modes = [self._merge_parts(belief, i, joint[i] / probability[i], parts[i]) for i in range(size)]
        return _combine_modes(probability / probability.sum(axis=0), modes, repaired)

    def _merge_parts(self, belief: MultiModelBelief, mode: int, weights: Array, parts: Sequence[Gaussian]) -> Belief:
        """Merge a mode's smoothed Gaussians, one for each mode to which the motion may change next."""
        motion, current = self.motions[mode], Gaussian(belief.modes[mode].mean, belief.modes[mode].covariance)
        _, *destinations = self.origins(mode)
        converted = [in_state_of(motion, current, self.motions[j], parts[j]) for j in destinations]
        return Belief(*moment_matched(weights[[mode, *destinations]], [parts[mode], *converted], motion.angular))

    def cartesian(self, belief: MultiModelBelief) -> Gaussian:
        """Return mean and covariance of px, py, vx, vy under the mixture of the modes."""
        parts = [filter.cartesian(mode) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return moment_matched(belief.probability, parts, ())

    def chain(self, dt: float) -> Array:
        """Return the modes' transition probabilities ``(M, M)`` over ``dt`` s; ``(M, M, batch)`` if members differ."""
        distinct, place = self._distinct_stays
        chains = [transition_probabilities(tuple(stay), dt) for stay in distinct]
        return chains[0] if place.ndim == 0 else np.stack(chains, axis=-1)[..., place]

    @cached_property
    def _distinct_stays(self) -> tuple[list[list[float]], Indices]:
        """Distinct sets of the modes' mean times in the batch, and the index of each member's set among them."""
        stay = linalg.vector(self.stay_s)
        distinct, place = np.unique(stay.reshape(len(stay), -1), axis=1, return_inverse=True)
        return distinct.T.tolist(), place.reshape(stay.shape[1:])

    def _mix_modes(self, belief: MultiModelBelief, chain: Array) -> MultiModelBelief:
        modes = []
        for j, motion in enumerate(self.motions):
            weights, parts = self.mixture(belief, chain, j)
            modes.append(Belief(*moment_matched(weights, parts, motion.angular)))
        probability = np.einsum("i...,ij...->j...", belief.probability, chain)
        return MultiModelBelief(probability, tuple(modes), belief.repaired)

    def mixture(self, belief: MultiModelBelief, chain: Array, to: int) -> tuple[Array, list[Gaussian]]:
        """Return what the mode ``to`` is mixed from: probabilities and beliefs of M modes, in the order of ``origins``.

        Probabilities ``(M, ...)`` are those of the modes given a transition to ``to``. Beliefs are in its state.
        """
        modes = [Gaussian(mode.mean, mode.covariance) for mode in belief.modes]
        _, *others = origins = self.origins(to)
        weights = np.stack([chain[i, to] * belief.probability[i] for i in origins])
        parts = [in_state_of(self.motions[to], modes[to], self.motions[i], modes[i]) for i in others]
        return weights / weights.sum(axis=0), [modes[to], *parts]

    def origins(self, to: int) -> list[int]:
        """Return the indices of the modes with a transition to ``to``; first ``to``, as its probability is never 0."""
        return [to, *(i for i in range(len(self.filters)) if i != to)]


def _combine_modes(probability: Array, modes: Sequence[Belief], repaired: Mask | None) -> MultiModelBelief:
    for mode in modes:
        repaired = either(repaired, mode.repaired)
    return MultiModelBelief(probability, tuple(mode._replace(repaired=None) for mode in modes), repaired)


def normalised(logarithm: Array) -> tuple[Array, Array]:
    """Normalise log-weights ``(M, ...)``: return probabilities, and the log ``(...)`` of the weights' sum."""
    largest = logarithm.max(axis=0)
    weights = np.maximum(np.exp(logarithm - largest), LEAST_PROBABILITY)
    total = weights.sum(axis=0)
    return weights / total, largest + np.log(total)

"""The interacting multiple model estimator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackbench import linalg
from trackbench.filters.base import Belief, MultiModelBelief, SingleModelFilter, Update, either
from trackbench.filters.mixing import in_state_of, moment_matched
from trackbench.models.motion import MotionModel
from trackbench.types import Array, Gaussian, Mask, Scan

#: The least probability of a mode: one that underflowed to zero could never come back where modes do not switch.
LEAST = 1e-300


@lru_cache(maxsize=256)
def transition_probabilities(stay_s: tuple[float, ...], dt: float) -> Array:
    """``(M, M)`` probability that the motion is that of model j (column) ``dt`` seconds after it was that of i (row).

    A Markov chain in continuous time: the motion stays with model i for an exponentially distributed time of mean
    ``stay_s[i]``, and then goes over to any of the others alike. So the chain does not depend on the rate of scans.
    """
    size, stay = len(stay_s), np.sqrt(stay_s)
    # With rates 1 / ((M - 1) stay_s[i]) the chain is reversible: scaled by the stays, the rate matrix is symmetric.
    rates = (np.ones((size, size)) - size * np.eye(size)) / (size - 1)
    values, vectors = np.linalg.eigh(rates / np.outer(stay, stay))
    scaled = (vectors * np.exp(values * dt)) @ vectors.T
    return np.asarray(np.clip(scaled * stay / stay[:, None], 0.0, 1.0))


@dataclass(frozen=True)
class InteractingMultipleModel:
    """The IMM estimator over filters of the same kind with different motion models, whose states may differ in size.

    Source: Blom and Bar-Shalom (1988); Bar-Shalom, Li and Kirubarajan (2001), section 11.6.6.
    """

    filters: tuple[SingleModelFilter, ...]
    stay_s: tuple[float, ...]
    """Mean time for which the motion stays with each model, s."""
    initial_probabilities: tuple[float, ...]

    @property
    def motions(self) -> tuple[MotionModel, ...]:
        """The motion models, one for each mode."""
        return tuple(filter.motion for filter in self.filters)

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> MultiModelBelief:
        """The belief of a track that starts where ``state_of`` says, in the state of each motion model."""
        modes = tuple(filter.begin(state_of) for filter in self.filters)
        batch = modes[0].mean.shape[1:]
        probability = np.array(self.initial_probabilities).reshape(-1, *(1 for _ in batch))
        return MultiModelBelief(np.broadcast_to(probability, (len(modes), *batch)), modes)

    def predict(self, belief: MultiModelBelief, dt: float) -> MultiModelBelief:
        """Mix the modes by the Markov chain, and predict each."""
        if dt > 0.0:
            belief = self._mixed(belief, transition_probabilities(self.stay_s, dt))
        modes = [filter.predict(mode, dt) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return _joined(belief.probability, modes, belief.repaired)

    def update(self, belief: MultiModelBelief, scan: Scan) -> Update[MultiModelBelief]:
        """Update each mode, and weigh it by the likelihood of the measurement.

        The innovation and its covariance are those of the mixture of what the modes predicted; the innovation is 0
        where the scan is not valid.
        """
        updates = [filter.update(mode, scan) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        log_likelihood = np.stack([update.log_likelihood for update in updates])
        said = [Gaussian(update.innovation, update.innovation_covariance) for update in updates]
        if not np.all(scan.valid):
            log_likelihood = np.where(scan.valid, log_likelihood, 0.0)
            said = [Gaussian(np.where(scan.valid, mean, 0.0), covariance) for mean, covariance in said]
        joint = np.log(belief.probability) + log_likelihood
        probability = _normalised(joint)
        after = _joined(probability, [update.belief for update in updates], belief.repaired)
        innovation, covariance = moment_matched(belief.probability, said, self.filters[0].measured(scan).angular)
        s = linalg.ensure_definite(covariance)
        mixture = np.logaddexp.reduce(joint, axis=0)
        return Update(after, innovation, s.covariance, s.factor.whiten(innovation), s.factor, mixture)

    def cartesian(self, belief: MultiModelBelief) -> Gaussian:
        """Mean and covariance of px, py, vx, vy under the mixture of the modes."""
        parts = [filter.cartesian(mode) for filter, mode in zip(self.filters, belief.modes, strict=True)]
        return moment_matched(belief.probability, parts, ())

    def _mixed(self, belief: MultiModelBelief, chain: Array) -> MultiModelBelief:
        """What each mode starts its prediction from: the modes that may have gone over to it, by their probability."""
        before, modes = belief.probability, [Gaussian(mode.mean, mode.covariance) for mode in belief.modes]
        probability = np.einsum("i...,ij->j...", before, chain)
        mixed = []
        for j, motion in enumerate(self.motions):
            others = [i for i in range(len(modes)) if i != j]
            come = [chain[i, j] * before[i] / probability[j] for i in (j, *others)]
            parts = [in_state_of(motion, modes[j], self.motions[i], modes[i]) for i in others]
            mixed.append(Belief(*moment_matched(come, [modes[j], *parts], motion.angular)))
        return MultiModelBelief(probability, tuple(mixed), belief.repaired)


def _joined(probability: Array, modes: Sequence[Belief], repaired: Mask | None) -> MultiModelBelief:
    """The modes as one belief, which has the marks of theirs."""
    for mode in modes:
        repaired = either(repaired, mode.repaired)
    return MultiModelBelief(probability, tuple(mode._replace(repaired=None) for mode in modes), repaired)


def _normalised(logarithm: Array) -> Array:
    """``(M, ...)`` probabilities from their logarithms, which may lack a common term."""
    weights = np.maximum(np.exp(logarithm - logarithm.max(axis=0)), LEAST)
    return np.asarray(weights / weights.sum(axis=0))

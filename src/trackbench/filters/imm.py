"""The interacting multiple model estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackbench import linalg
from trackbench.filters.base import Belief, Modes, SingleModelFilter, Update, either
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

    def begin(self, state_of: Callable[[MotionModel], Gaussian]) -> Belief:
        """The belief of a track that starts where ``state_of`` says, in the state of each motion model."""
        beliefs = tuple(filter.begin(state_of) for filter in self.filters)
        batch = beliefs[0].mean.shape[1:]
        probability = np.array(self.initial_probabilities).reshape(-1, *(1 for _ in batch))
        return self._mixture(np.broadcast_to(probability, (len(beliefs), *batch)), beliefs)

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Mix the modes by the Markov chain, and predict each."""
        modes = _modes(belief)
        if dt > 0.0:
            modes = self._mixed(modes, transition_probabilities(self.stay_s, dt))
        predicted = tuple(filter.predict(mode, dt) for filter, mode in zip(self.filters, modes.beliefs, strict=True))
        return self._mixture(modes.probability, predicted, belief.repaired)

    def update(self, belief: Belief, scan: Scan) -> Update:
        """Update each mode, and weigh it by the likelihood of the measurement.

        The innovation and its covariance are those of the mixture of what the modes predicted.
        """
        modes = _modes(belief)
        updates = [filter.update(mode, scan) for filter, mode in zip(self.filters, modes.beliefs, strict=True)]
        log_likelihood = np.stack([np.where(scan.valid, update.log_likelihood, 0.0) for update in updates])
        probability = _normalised(np.log(modes.probability) + log_likelihood)
        after = self._mixture(probability, tuple(update.belief for update in updates), belief.repaired)
        angular = self.filters[0].measured(scan).angular
        said = [Gaussian(np.where(scan.valid, u.innovation, 0.0), u.innovation_covariance) for u in updates]
        innovation = moment_matched(modes.probability, said, said[0].mean, angular)
        s = linalg.ensure_definite(innovation.covariance)
        mean = np.where(scan.valid, innovation.mean, np.nan)
        return Update(after, mean, s.covariance, s.factor.whiten(mean), s.factor)

    def cartesian(self, belief: Belief) -> Gaussian:
        """px, py, vx, vy under the mixture of the modes."""
        return Gaussian(belief.mean, belief.covariance)

    def _mixed(self, modes: Modes, chain: Array) -> Modes:
        """What each mode starts its prediction from: the modes that may have gone over to it, by their probability."""
        probability = np.einsum("i...,ij->j...", modes.probability, chain)
        mixed = []
        for j, (motion, own) in enumerate(zip(self.motions, modes.beliefs, strict=True)):
            come = chain[:, j].reshape(-1, *(1 for _ in probability.shape[1:])) * modes.probability / probability[j]
            parts = [
                _gaussian(own) if i == j else in_state_of(motion, _gaussian(own), other, _gaussian(belief))
                for i, (other, belief) in enumerate(zip(self.motions, modes.beliefs, strict=True))
            ]
            mixed.append(Belief(*moment_matched(come, parts, own.mean, motion.angular)))
        return Modes(probability, tuple(mixed))

    def _mixture(self, probability: Array, beliefs: tuple[Belief, ...], repaired: Mask | None = None) -> Belief:
        parts = [filter.cartesian(belief) for filter, belief in zip(self.filters, beliefs, strict=True)]
        mean, covariance = moment_matched(probability, parts, parts[0].mean, ())
        for belief in beliefs:
            repaired = either(repaired, belief.repaired)
        clear = tuple(belief._replace(repaired=None) for belief in beliefs)
        return Belief(mean, covariance, repaired=repaired, modes=Modes(probability, clear))


def _modes(belief: Belief) -> Modes:
    assert belief.modes is not None
    return belief.modes


def _gaussian(belief: Belief) -> Gaussian:
    return Gaussian(belief.mean, belief.covariance)


def _normalised(logarithm: Array) -> Array:
    """``(M, ...)`` probabilities from their logarithms, which may lack a common term."""
    weights = np.maximum(np.exp(logarithm - logarithm.max(axis=0)), LEAST)
    return np.asarray(weights / weights.sum(axis=0))

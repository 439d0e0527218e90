"""What a track is if each of its detections may be that of its object, or none.

Each track takes the mixture of its prediction and of its update with each detection, or rather a Gaussian of the same
mean and covariance. Of a filter with several motion models the mode probabilities are mixed, and each mode by the
probability that a possibility has if the motion is that of the mode. Source: Houles and Bar-Shalom (1989),
"Multisensor tracking of a maneuvering target in clutter", for one target; the association probabilities are here those
of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices
from trackbench.base.units import difference
from trackbench.filters import AnyBelief, Belief, MultiModelBelief
from trackbench.filters.base import wrap_components
from trackbench.filters.imm import LEAST
from trackbench.models.motion import MotionModel


def of_pairs(
    motions: Sequence[MotionModel], before: AnyBelief, updated: AnyBelief, track: Indices, share: Array, kept: Array
) -> AnyBelief:
    """Of L tracks, with the possibilities side by side.

    Args:
        motions: the motion models.
        before: ``(n, L)`` the predictions.
        updated: ``(n, P)`` of each pair of a track and a detection, of one at least.
        track: ``(P,)`` ascending.
        share: ``(P,)`` the probability of each pair.
        kept: ``(L,)`` the probability that there was no detection.
    """
    begins = np.flatnonzero(np.diff(track, prepend=-1))
    own = track[begins]

    def one_model(angular: tuple[int, ...], before: Belief, updated: Belief, share: Array, kept: Array) -> Belief:
        mean, covariance = before.mean.copy(), before.covariance.copy()
        parts = _parts(angular, mean[:, track], updated, share)
        shift, spread = (np.add.reduceat(part, begins, axis=-1) for part in parts)
        found = _mixed(angular, Belief(mean[:, own], covariance[..., own]), shift, spread, kept[own])
        mean[:, own], covariance[..., own] = found.mean, found.covariance
        return Belief(mean, covariance)

    if isinstance(before, Belief):
        assert isinstance(updated, Belief)
        return one_model(motions[0].angular, before, updated, share, kept)
    assert isinstance(before, MultiModelBelief)
    assert isinstance(updated, MultiModelBelief)
    missed, hit = kept * before.probability, share * updated.probability
    probability = np.stack([np.bincount(track, each, len(kept)) for each in hit]) + missed
    probability = np.maximum(probability, LEAST)
    modes = [
        one_model(motion.angular, one, other, hit[j] / probability[j, track], missed[j] / probability[j])
        for j, (motion, one, other) in enumerate(zip(motions, before.modes, updated.modes, strict=True))
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def of_slots(
    motions: Sequence[MotionModel],
    before: AnyBelief,
    updated: Sequence[AnyBelief],
    share: Sequence[Array],
    kept: Array,
) -> AnyBelief:
    """Of tracks that all have the same number of possibilities.

    Args:
        motions: the motion models.
        before: ``(n, ...)`` the predictions.
        updated: ``(n, ...)`` with each detection.
        share: ``(...)`` the probability of each.
        kept: ``(...)`` the probability that there was no detection.
    """

    def one_model(
        angular: tuple[int, ...], before: Belief, updated: Sequence[Belief], share: Sequence[Array], kept: Array
    ) -> Belief:
        parts = [_parts(angular, before.mean, one, weight) for one, weight in zip(updated, share, strict=True)]
        shift, spread = (reduce(add, each) for each in zip(*parts, strict=True))
        return _mixed(angular, before, shift, spread, kept)

    singles = [one for one in updated if isinstance(one, Belief)]
    if isinstance(before, Belief):
        return one_model(motions[0].angular, before, singles, share, kept)
    several = [one for one in updated if isinstance(one, MultiModelBelief)]
    missed, hit = (
        kept * before.probability,
        [weight * one.probability for one, weight in zip(several, share, strict=True)],
    )
    probability = np.maximum(reduce(add, hit) + missed, LEAST)
    modes = [
        one_model(
            motion.angular,
            before.modes[j],
            [one.modes[j] for one in several],
            [each[j] / probability[j] for each in hit],
            missed[j] / probability[j],
        )
        for j, motion in enumerate(motions)
    ]
    return MultiModelBelief(probability / probability.sum(axis=0), tuple(modes))


def _parts(angular: tuple[int, ...], mean: Array, updated: Belief, share: Array) -> tuple[Array, Array]:
    """What a possibility adds to the first and to the second moment about the prediction."""
    offset = difference(updated.mean, mean, angular)
    return share * offset, share * (updated.covariance + offset[:, None] * offset[None])


def _mixed(angular: tuple[int, ...], before: Belief, shift: Array, spread: Array, kept: Array) -> Belief:
    """The Gaussian of those moments.

    For a gain that is the same for each detection its covariance is the usual one with the spread of the innovations.
    """
    covariance = kept * before.covariance + (spread - shift[:, None] * shift[None])
    return Belief(wrap_components(before.mean + shift, angular), linalg.symmetrise(covariance))

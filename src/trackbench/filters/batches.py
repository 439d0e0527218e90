"""Beliefs of several filters alike, member by member of their batch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackbench.base.types import Array, Indices, Mask, indices
from trackbench.filters.base import AnyBelief, Belief, MultiModelBelief, PredictedMeasurement


def mapped(function: Callable[..., Array], *beliefs: AnyBelief) -> AnyBelief:
    """What a function makes of the mean, of the covariance and of the mode probabilities of beliefs of one filter.

    What a filter could reuse is left out.
    """
    if isinstance(beliefs[0], Belief):
        singles = [belief for belief in beliefs if isinstance(belief, Belief)]
        return Belief(function(*(one.mean for one in singles)), function(*(one.covariance for one in singles)))
    several = [belief for belief in beliefs if isinstance(belief, MultiModelBelief)]
    modes = [mapped(function, *each) for each in zip(*(one.modes for one in several), strict=True)]
    probability = function(*(one.probability for one in several))
    return MultiModelBelief(probability, tuple(mode for mode in modes if isinstance(mode, Belief)))


def bare(belief: AnyBelief) -> AnyBelief:
    """Without what it can be computed from."""
    return mapped(lambda values: values, belief)


def select(belief: AnyBelief, which: Mask | Indices) -> AnyBelief:
    """Some members of the last batch axis."""
    index = indices(which) if which.dtype == bool else which
    # An index in brackets is slower, and leaves an array whose batch axis no longer comes last in memory.
    return mapped(lambda values: values.take(index, axis=-1), belief)


def selected_prediction(predicted: PredictedMeasurement, which: Indices) -> PredictedMeasurement:
    """The same of a predicted measurement."""
    modes = tuple(selected_prediction(mode, which) for mode in predicted.modes)
    mean, covariance, cross = (part.take(which, axis=-1) for part in predicted[:3])
    return PredictedMeasurement(mean, covariance, cross, modes)


def concatenated(first: AnyBelief, second: AnyBelief) -> AnyBelief:
    """Along the last batch axis."""
    return mapped(lambda a, b: np.concatenate([a, b], axis=-1), first, second)


def placed(belief: AnyBelief, where: Indices, members: AnyBelief) -> AnyBelief:
    """The belief with some members of the last batch axis in place of its own."""

    def put(values: Array, others: Array) -> Array:
        found = values.copy()
        found[..., where] = others
        return found

    return mapped(put, belief, members)


def choose(where: Mask, a: AnyBelief, b: AnyBelief) -> AnyBelief:
    """``a`` where it holds, ``b`` elsewhere; both are of the same filter.

    Sigma points are kept if ``a`` has them; if ``b`` has none, it is a placeholder whose points do not count.
    """
    if isinstance(a, Belief):
        assert isinstance(b, Belief)
        return _choose_one(where, a, b)
    assert isinstance(b, MultiModelBelief)
    probability = np.where(where, a.probability, b.probability)
    modes = tuple(_choose_one(where, one, other) for one, other in zip(a.modes, b.modes, strict=True))
    return MultiModelBelief(probability, modes, _choose_marks(where, a.repaired, b.repaired))


def _choose_one(where: Mask, a: Belief, b: Belief) -> Belief:
    points = a.points if a.points is None or b.points is None else np.where(where, a.points, b.points)
    mean, covariance = np.where(where, a.mean, b.mean), np.where(where, a.covariance, b.covariance)
    return Belief(mean, covariance, points=points, repaired=_choose_marks(where, a.repaired, b.repaired))


def _choose_marks(where: Mask, a: Mask | None, b: Mask | None) -> Mask | None:
    return None if a is None and b is None else np.where(where, a is not None and a, b is not None and b)

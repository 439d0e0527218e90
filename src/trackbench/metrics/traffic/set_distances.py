"""GOSPA of sets of positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.assignment import Counted


class GospaParts(NamedTuple):
    """The parts of GOSPA to the power p, ``(T,)`` each; the metric is the p-th root of their sum."""

    localisation: Array
    """Distances of matched pairs."""
    missed: Array
    """``c^p / 2`` for each object without a track."""
    false: Array
    """``c^p / 2`` for each track without an object."""

    @property
    def total(self) -> Array:
        """``(T,)``."""
        return self.localisation + self.missed + self.false


def gospa(counted: Counted) -> GospaParts:
    """Generalised optimal sub-pattern assignment metric with alpha = 2 and p = 2.

    Of the best matching, the squared distances of the pairs plus c^2 / 2 for each object and each track that is in
    none; the metric is the root.

    Source: Rahmathullah, Garcia-Fernandez and Svensson (2017), "Generalized optimal sub-pattern assignment metric",
    definition 1 and proposition 1.
    """
    matched = counted.matched
    numbers = counted.due.sum(axis=1), counted.present.sum(axis=1)
    return parts_of_matching(matched.instant, matched.distance, *numbers, counted.cutoff, 2.0)


def parts_of_matching(
    instant: Indices, distance: Array, objects: Indices, tracks: Indices, cutoff: float, p: float
) -> GospaParts:
    """Return the parts of GOSPA to the power p.

    Args:
        instant: ``(P,)`` of each matched pair.
        distance: ``(P,)`` of each matched pair, m.
        objects: ``(T,)`` their numbers.
        tracks: ``(T,)`` their numbers.
        cutoff: c, m.
        p: the exponent.
    """
    steps = len(objects)
    pairs = np.bincount(instant, minlength=steps)
    half = cutoff**p / 2
    localisation = np.bincount(instant, distance**p, minlength=steps)
    return GospaParts(np.asarray(localisation, dtype=float), half * (objects - pairs), half * (tracks - pairs))

"""GOSPA (generalized optimal sub-pattern assignment) between the positions of objects and of tracks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.assignment import Counted


class GospaParts(NamedTuple):
    """Parts of GOSPA to the power p at each instant, ``(T,)``; GOSPA is the p-th root of their sum."""

    localisation: Array
    """``(T,)`` sum over matched pairs of the distance to the power p."""
    missed: Array
    """``(T,)`` cost of missed objects: ``c^p / 2`` times the number of objects without a track."""
    false: Array
    """``(T,)`` cost of false tracks: ``c^p / 2`` times the number of tracks without an object."""

    @property
    def total(self) -> Array:
        """``(T,)`` GOSPA to the power p at each instant: the sum of localisation, missed and false."""
        return self.localisation + self.missed + self.false


def gospa(counted: Counted) -> GospaParts:
    """Return the parts of squared GOSPA, with alpha = 2 and p = 2, at each instant.

    Squared GOSPA is the sum of the squared distances in the best matching, plus c^2 / 2 for each object and each track
    without a partner.

    Source: Rahmathullah, Garcia-Fernandez and Svensson (2017), "Generalized optimal sub-pattern assignment metric",
    definition 1 and proposition 1.
    """
    matched = counted.matched
    numbers = counted.due.sum(axis=1), counted.present.sum(axis=1)
    return parts_of_matching(matched.instant, matched.distance, *numbers, counted.cutoff, 2.0)


def parts_of_matching(
    instant: Indices, distance: Array, objects: Indices, tracks: Indices, cutoff: float, p: float
) -> GospaParts:
    """Return the parts of GOSPA to the power p at each of T instants: localisation, missed objects, false tracks.

    Args:
        instant: ``(P,)`` index of the instant of each matched pair.
        distance: ``(P,)`` distance of each matched pair, m.
        objects: ``(T,)`` number of objects at each instant.
        tracks: ``(T,)`` number of tracks at each instant.
        cutoff: cutoff distance c, m.
        p: exponent of the distances.
    """
    steps = len(objects)
    pairs = np.bincount(instant, minlength=steps)
    half = cutoff**p / 2
    localisation = np.bincount(instant, distance**p, minlength=steps)
    return GospaParts(np.asarray(localisation, dtype=float), half * (objects - pairs), half * (tracks - pairs))

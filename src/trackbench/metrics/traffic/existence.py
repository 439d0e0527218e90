"""Whether of the tracks that state an existence probability of .8, 80 % are real."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted

#: Equal parts of the range from 0 to 1.
BINS = 10


class ExistenceBins(NamedTuple):
    """Sums over tracks and instants, each ``(10,)``; they add up over runs."""

    stated: Array
    """Existence probabilities."""
    real: Indices
    """Tracks that are matched with an object."""
    number: Indices
    """Tracks."""


def existence_bins(counted: Counted, existence: Array) -> ExistenceBins:
    """Tracks by the probability that they state ``(T, K)``: a reliability diagram.

    Source: Murphy and Winkler (1977), "Reliability of subjective probability forecasts of precipitation and
    temperature".
    """
    real: Mask = np.zeros(counted.present.shape, dtype=bool)
    real[counted.matched.instant, counted.matched.column] = True
    known = counted.present & np.isfinite(existence)
    stated = existence[known]
    which = np.clip((stated * BINS).astype(np.intp), 0, BINS - 1)
    return ExistenceBins(
        np.asarray(np.bincount(which, stated, BINS), dtype=float),
        np.bincount(which[real[known]], minlength=BINS),
        np.bincount(which, minlength=BINS),
    )

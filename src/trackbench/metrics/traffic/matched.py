"""Errors and consistency of the tracks that are matched with an object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.linalg import cholesky, symmetrise
from trackbench.base.types import Array
from trackbench.metrics.consistency import point95
from trackbench.metrics.traffic.assignment import NearPairs
from trackbench.metrics.traffic.histories import TrackHistory, TruthHistory


class MatchedErrors(NamedTuple):
    """Of the matched pairs of a run: sums and the numbers of their terms."""

    position: tuple[float, float]
    """Squared errors, m^2."""
    velocity: tuple[float, float]
    """Squared errors, (m/s)^2; tracks without a velocity do not count."""
    nees: tuple[float, float]
    """Normalised estimation error squared, 4 degrees of freedom; covariances that are not positive definite do not
    count. Source: Bar-Shalom, Li and Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation",
    section 5.4.2."""
    inside: tuple[float, float]
    """Those of them up to the 95 % quantile of chi-square with 4 degrees of freedom."""


def matched_errors(truth: TruthHistory, tracks: TrackHistory, matched: NearPairs) -> MatchedErrors:
    """Errors are estimate minus truth, in the fixed frame."""
    error = tracks.mean[:, matched.instant, matched.column] - truth.state[:, matched.instant, matched.object]
    factor = cholesky(symmetrise(tracks.covariance[:, :, matched.instant, matched.column]))
    squares = error**2
    nees = (factor.whiten(error) ** 2).sum(axis=0)[factor.positive]
    inside = np.where(np.isfinite(nees), nees <= point95(4), np.nan)
    return MatchedErrors(
        _finite_sum(squares[:2].sum(axis=0)),
        _finite_sum(squares[2:].sum(axis=0)),
        _finite_sum(nees),
        _finite_sum(inside),
    )


def _finite_sum(values: Array) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return float(known.sum()), float(len(known))

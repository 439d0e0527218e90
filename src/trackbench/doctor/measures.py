"""How far off a track is in an exhibit, and how far it says that it may be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.doctor.exhibits import Exhibit
from trackbench.metrics.consistency import normalised_square
from trackbench.types import Array, Mask


class Measures(NamedTuple):
    """Of one track, after each scan; NaN where there is no estimate."""

    error: Array
    """``(scans,)`` distance of the estimated position from the true one, m."""
    claimed: Array
    """``(scans,)`` twice the standard deviation of that distance after the track's own covariance, m."""
    nees: Array
    """``(scans,)`` of position and velocity; NaN where the covariance is not positive definite."""


def measures(exhibit: Exhibit) -> dict[str, Measures]:
    """Of the tracker and of the reference, by name."""
    return {
        "tracker": _of(exhibit.mean, exhibit.covariance, exhibit.target),
        "reference": _of(exhibit.reference_mean, exhibit.reference_covariance, exhibit.target),
    }


def _of(mean: Array, covariance: Array, target: Array) -> Measures:
    known: Mask = np.asarray(np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1)))
    error = np.where(known, mean - target, np.nan)
    claimed = np.full(len(known), np.nan)
    claimed[known] = 2.0 * np.sqrt(np.maximum(covariance[0, 0, known] + covariance[1, 1, known], 0.0))
    nees = np.full(len(known), np.nan)
    square, _, positive = normalised_square(error[:, known], covariance[:, :, known])
    nees[known] = np.where(positive, square, np.nan)
    return Measures(np.hypot(error[0], error[1]), claimed, nees)

"""The errors of the tracker and of the reference in an evidence run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.metrics.consistency import normalised_square
from trackbench.subjects.doctor.evidence import EvidenceRun


class RunErrors(NamedTuple):
    """After each scan; NaN where there is no estimate."""

    position: Array
    """``(scans,)`` distance of the estimated position from the true one, m."""
    two_sigma: Array
    """``(scans,)`` twice the standard deviation of that distance by the estimate's own covariance, m."""
    nees: Array
    """``(scans,)`` of position and velocity; NaN where the covariance is not positive definite."""


def run_errors(run: EvidenceRun) -> dict[str, RunErrors]:
    """By name: "tracker" and "reference"."""
    return {
        "tracker": _errors(run.mean, run.covariance, run.target),
        "reference": _errors(run.reference_mean, run.reference_covariance, run.target),
    }


def _errors(mean: Array, covariance: Array, target: Array) -> RunErrors:
    known: Mask = np.asarray(np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1)))
    error = np.where(known, mean - target, np.nan)
    two_sigma = np.full(len(known), np.nan)
    two_sigma[known] = 2.0 * np.sqrt(np.maximum(covariance[0, 0, known] + covariance[1, 1, known], 0.0))
    nees = np.full(len(known), np.nan)
    square, _, positive = normalised_square(error[:, known], covariance[:, :, known])
    nees[known] = np.where(positive, square, np.nan)
    return RunErrors(np.hypot(error[0], error[1]), two_sigma, nees)

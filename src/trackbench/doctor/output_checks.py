"""Checks of every estimate: finite numbers, and a symmetric positive definite covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.types import Array, Estimate, Scan

#: Probe and drive with a range of zero: the azimuth is undefined there, and a correct covariance can become indefinite
#: by rounding.
SINGULAR = ("at_sensor", "on_the_sensor")

#: Negative eigenvalue that rounding does not explain, of a covariance scaled to unit variances.
NEGATIVE = 1e-6


@dataclass(frozen=True)
class WorstCase:
    """The largest violation of one check."""

    size: float
    where: str
    """The probe or test drive."""
    time: float
    """s"""
    sensor: str


class OutputChecks:
    """The estimates of a whole examination, counted, and the worst of them."""

    def __init__(self) -> None:
        self.estimates = 0
        self.indefinite_estimates = 0
        self.not_finite: WorstCase | None = None
        """The first one."""
        self.asymmetry: WorstCase | None = None
        """Difference of mirrored entries over the geometric mean of their variances."""
        self.indefinite: WorstCase | None = None
        """Smallest eigenvalue of the covariance scaled to unit variances, with the sign changed."""

    def add(self, estimate: Estimate | None, scan: Scan, where: str) -> None:
        """Check an estimate after an ordinary scan; None counts as no estimate."""
        if estimate is not None:
            self.add_batch(estimate.mean[:, None], estimate.covariance[..., None], scan, where)

    def add_batch(self, mean: Array, covariance: Array, scan: Scan, where: str) -> None:
        """Check the estimates ``(4, runs)`` and ``(4, 4, runs)`` after an ordinary scan."""
        self.estimates += mean.shape[1]
        finite = np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        if not finite.all():
            self.not_finite = self.not_finite or WorstCase(1.0, where, scan.time, scan.sensor)
        p = np.moveaxis(covariance[:, :, finite], -1, 0)
        if len(p) == 0 or where in SINGULAR:
            return
        scale = np.sqrt(np.maximum(np.abs(np.diagonal(p, axis1=1, axis2=2)), np.finfo(float).tiny))
        relative = p / (scale[:, :, None] * scale[:, None, :])
        mirrored = np.swapaxes(relative, 1, 2)
        self.asymmetry = _worse(self.asymmetry, float(np.abs(relative - mirrored).max()), scan, where)
        least = np.linalg.eigvalsh(0.5 * (relative + mirrored))[:, 0]
        self.indefinite_estimates += int(np.sum(least < -NEGATIVE))
        self.indefinite = _worse(self.indefinite, float(-least.min()), scan, where)


def _worse(known: WorstCase | None, size: float, scan: Scan, where: str) -> WorstCase:
    if known is None or size > known.size:
        return WorstCase(size, where, scan.time, scan.sensor)
    return known

"""Whether what a tracker says can be a distribution at all, looked at in every answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.doctor.session import Answer
from trackbench.types import Array, Scan

#: Where the range is zero no azimuth means anything, and a sound covariance may be lost to rounding.
SINGULAR = ("at_sensor", "on_the_sensor")

#: Negative eigenvalue that rounding does not explain, of a covariance scaled to variances of one.
NEGATIVE = 1e-6


@dataclass(frozen=True)
class Symptom:
    """The worst of its kind."""

    size: float
    where: str
    """The station or drive."""
    time: float
    """s"""
    sensor: str


class Vitals:
    """Finite numbers, symmetric and positive definite covariances."""

    def __init__(self) -> None:
        self.answers = 0
        self.indefinite_answers = 0
        self.not_finite: Symptom | None = None
        self.asymmetry: Symptom | None = None
        """Difference of mirrored entries over the geometric mean of the variances that belong to them."""
        self.indefinite: Symptom | None = None
        """Smallest eigenvalue of the correlation-like matrix, negative."""

    def note(self, answer: Answer | None, scan: Scan, where: str) -> None:
        """Look at an answer to a natural measurement."""
        if answer is not None:
            self.note_all(answer.mean[:, None], answer.covariance[..., None], scan, where)

    def note_all(self, mean: Array, covariance: Array, scan: Scan, where: str) -> None:
        """Look at the answers ``(4, runs)`` and ``(4, 4, runs)`` to a natural measurement."""
        self.answers += mean.shape[1]
        finite = np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        if not finite.all():
            self.not_finite = self.not_finite or Symptom(1.0, where, scan.time, scan.sensor)
        p = np.moveaxis(covariance[:, :, finite], -1, 0)
        if len(p) == 0 or where in SINGULAR:
            return
        scale = np.sqrt(np.maximum(np.abs(np.diagonal(p, axis1=1, axis2=2)), np.finfo(float).tiny))
        relative = p / (scale[:, :, None] * scale[:, None, :])
        mirrored = np.swapaxes(relative, 1, 2)
        self.asymmetry = self._worse(self.asymmetry, float(np.abs(relative - mirrored).max()), scan, where)
        least = np.linalg.eigvalsh(0.5 * (relative + mirrored))[:, 0]
        self.indefinite_answers += int(np.sum(least < -NEGATIVE))
        self.indefinite = self._worse(self.indefinite, float(-least.min()), scan, where)

    @staticmethod
    def _worse(known: Symptom | None, size: float, scan: Scan, where: str) -> Symptom:
        if known is None or size > known.size:
            return Symptom(size, where, scan.time, scan.sensor)
        return known

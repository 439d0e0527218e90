"""Checks of every estimate: finite numbers, and a symmetric positive definite covariance."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from trackbench.base.types import Array, Estimate, Scan

#: Probe and drive with a range of zero: the azimuth is undefined there, and a correct covariance can become indefinite
#: by rounding.
SINGULAR = ("at_sensor", "on_the_sensor")
#: The drive that a gate may end: in its gap the target turns away from where the motion model has it.
BEYOND = "gap_in_a_turn"

#: Negative eigenvalue that rounding does not explain, of a covariance scaled to unit variances.
NEGATIVE = 1e-6


@contextmanager
def quiet() -> Iterator[None]:
    """Without warnings of numbers that are not finite: the checks look for them."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@dataclass(frozen=True)
class WorstCase:
    """The largest violation of one check."""

    size: float
    where: str
    """The probe or test drive."""
    time: float
    """s"""
    sensor: str
    given: Callable[[], Sequence[Scan]]
    """All scans that the tracker was given, up to that time; without batch axes."""


class OutputChecks:
    """The estimates of a whole examination, counted, and the worst of them."""

    def __init__(self) -> None:
        self.estimates = 0
        self.indefinite_estimates = 0
        self.not_finite: WorstCase | None = None
        """The first one, and of those at a range of zero only where there is no other."""
        self.asymmetry: WorstCase | None = None
        """Difference of mirrored entries over the geometric mean of their variances."""
        self.indefinite: WorstCase | None = None
        """Smallest eigenvalue of the covariance scaled to unit variances, with the sign changed."""

    def add(self, estimate: Estimate | None, scan: Scan, where: str, given: Sequence[Scan]) -> None:
        """Check an estimate after an ordinary scan, the last of those given; None counts as no estimate."""
        known = len(given)
        if estimate is not None:
            one = estimate.mean[:, None], estimate.covariance[..., None]
            self.add_batch(*one, [scan], where, lambda _: given[:known])

    def add_track(self, estimates: Sequence[Estimate | None], scans: Sequence[Scan], where: str) -> None:
        """Check the estimates of a track, each after the ordinary scan of the same place; None counts as none."""
        known = [(k, one) for k, one in enumerate(estimates) if one is not None]
        if known:
            mean = np.stack([one.mean for _, one in known], axis=-1)
            covariance = np.stack([one.covariance for _, one in known], axis=-1)
            self.add_batch(mean, covariance, [scans[k] for k, _ in known], where, lambda i: scans[: known[i][0] + 1])

    def add_batch(
        self, mean: Array, covariance: Array, scans: Sequence[Scan], where: str, given: Callable[[int], Sequence[Scan]]
    ) -> None:
        """Check the estimates ``(4, n)`` and ``(4, 4, n)``, each after an ordinary scan.

        ``given(i)`` are the scans up to and with that of estimate ``i``, in its run.
        """
        self.estimates += mean.shape[1]
        finite = np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        before = self.not_finite
        if not finite.all() and (before is None or (before.where in SINGULAR and where not in SINGULAR)):
            first = int(np.argmin(finite))
            self.not_finite = _case(1.0, scans[first], where, partial(given, first))
        known = np.flatnonzero(finite)
        if len(known) == 0 or where in SINGULAR:
            return
        relative = scaled_covariances(np.moveaxis(covariance[:, :, known], -1, 0))
        apart, least = asymmetry(relative), least_eigenvalue(relative)
        self.indefinite_estimates += int(np.sum(least < -NEGATIVE))
        most, lowest = int(known[np.argmax(apart)]), int(known[np.argmin(least)])
        largest, smallest = float(apart.max()), float(least.min())
        if self.asymmetry is None or largest > self.asymmetry.size:
            self.asymmetry = _case(largest, scans[most], where, partial(given, most))
        if self.indefinite is None or -smallest > self.indefinite.size:
            self.indefinite = _case(-smallest, scans[lowest], where, partial(given, lowest))


def scaled_covariances(p: Array, like: Array | None = None) -> Array:
    """Covariances ``(..., 4, 4)`` in standard deviations: their own, or those of others."""
    variances = np.abs(np.diagonal(p if like is None else like, axis1=-2, axis2=-1))
    scale = np.sqrt(np.maximum(variances, np.finfo(float).tiny))
    return np.asarray(p / (scale[..., :, None] * scale[..., None, :]))


def asymmetry(relative: Array) -> Array:
    """Largest difference of mirrored entries of scaled covariances ``(..., 4, 4)``."""
    return np.asarray(np.abs(relative - np.swapaxes(relative, -2, -1)).max(axis=(-2, -1)))


def least_eigenvalue(relative: Array) -> Array:
    """Of the symmetric parts of scaled covariances ``(..., 4, 4)``."""
    return np.asarray(np.linalg.eigvalsh(0.5 * (relative + np.swapaxes(relative, -2, -1)))[..., 0])


def _case(size: float, scan: Scan, where: str, given: Callable[[], Sequence[Scan]]) -> WorstCase:
    return WorstCase(size, where, scan.time, scan.sensor, given)

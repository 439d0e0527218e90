"""Checks of every estimate: finite numbers, a symmetric positive definite covariance, and where one ceases to be it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base.types import COMMON_STATE, Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.subjects.doctor.matrices import largest_entry
from trackbench.subjects.doctor.session import StepFailed, TrackerSession, finite
from trackbench.trackers.answers import Tracker

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
        """The first one."""
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
            mean = np.stack([estimate.mean for _, estimate in known], axis=-1)
            covariance = np.stack([estimate.covariance for _, estimate in known], axis=-1)
            self.add_batch(mean, covariance, [scans[k] for k, _ in known], where, lambda i: scans[: known[i][0] + 1])

    def add_batch(
        self, mean: Array, covariance: Array, scans: Sequence[Scan], where: str, given: Callable[[int], Sequence[Scan]]
    ) -> None:
        """Check the estimates ``(4, n)`` and ``(4, 4, n)``, each after an ordinary scan.

        ``given(i)`` are the scans up to and with that of estimate ``i``, in its run.
        """
        self.estimates += mean.shape[1]
        finite = np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        if not finite.all() and self.not_finite is None:
            first = int(np.argmin(finite))
            self.not_finite = _case(1.0, scans[first], where, partial(given, first))
        known = np.flatnonzero(finite)
        if len(known) == 0:
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


#: Asymmetry, and negative eigenvalue, that rounding does not explain, of a covariance scaled to unit variances.
ROUNDING = 1e-6
Make = Callable[[], Tracker]
Measure = Callable[[Array], Array]
Blame = Callable[[Array, Array, Array | None], bool]
"""Of the covariances before a step, predicted and after it: whether the prediction is to blame."""


class FaultyStep(NamedTuple):
    """The first step of a track that makes its covariance wrong."""

    step: Literal["start", "prediction", "update"]
    scan: Scan
    before: Array | None
    """``(4, 4)`` the covariance before that step: the estimate's, or the one predicted to the update."""
    after: Array
    """``(4, 4)`` the first wrong one."""

    @property
    def words(self) -> str:
        """The step and its time."""
        if self.step == "start":
            return f"in the first estimate, at {self.scan.time:.4g} s"
        of = f" with {self.scan.sensor}" if self.step == "update" else ""
        # What was predicted to it is not known of a tracker that is given no scans without a detection.
        step = "step" if self.before is None else self.step
        return f"in the {step}{of} at {self.scan.time:.4g} s"


def asymmetric(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """The step after which the covariance is first not symmetric."""

    def adds_more(before: Array, predicted: Array, after: Array | None) -> bool:
        """Whether the prediction adds more to the asymmetry than the update does."""
        first, then = (asymmetry(scaled_covariances(p, like=predicted)) for p in (before, predicted))
        return bool(
            then > ROUNDING
            and (after is None or then - first >= asymmetry(scaled_covariances(after, like=predicted)) - then)
        )

    return _origin(make, scans, asymmetry, adds_more)


def indefinite(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """The step after which the covariance is first not positive definite."""

    def is_wrong(_before: Array, predicted: Array, _after: Array | None) -> bool:
        """An update is right only of a positive definite covariance."""
        return bool(least_eigenvalue(scaled_covariances(predicted)) < -ROUNDING)

    return _origin(make, scans, lambda relative: -least_eigenvalue(relative), is_wrong)


def fault_of_step(fault: str, of: FaultyStep | None) -> str:
    """The fault of an update, or the same of a prediction where it arises there."""
    return f"predicted_{fault}" if of is not None and of.step == "prediction" else fault


def mirrored_entries(of: FaultyStep) -> str:
    """The two mirrored entries that differ most, and what they were before."""
    i, j = _mirrored(of)
    row, column = COMMON_STATE[i], COMMON_STATE[j]
    text = f"row {row}, column {column} is {of.after[i, j]:.6g} and row {column}, column {row} {of.after[j, i]:.6g}"
    return text if of.before is None else f"{text} ({of.before[i, j]:.6g} and {of.before[j, i]:.6g} before it)"


def indefinite_entries(of: FaultyStep) -> str:
    """The negative variance or the correlation beyond one, if there is one, and the smallest eigenvalues."""
    variances = np.diag(of.after)
    relative = scaled_covariances(of.after)
    i, j = _correlated(of)
    text = f"the smallest eigenvalue, scaled to unit variances, is {least_eigenvalue(relative):.3g}"
    if of.before is not None:
        text += f" ({least_eigenvalue(scaled_covariances(of.before)):.3g} before it)"
    if variances.min() < 0.0:
        worst = int(np.argmin(variances))
        return f"{text}; the variance of {COMMON_STATE[worst]} is {variances[worst]:.3g}"
    if abs(relative[i, j]) > 1.0:
        return f"{text}; the correlation of {COMMON_STATE[i]} and {COMMON_STATE[j]} is {relative[i, j]:.4g}"
    return text


def _mirrored(of: FaultyStep) -> tuple[int, int]:
    relative = scaled_covariances(of.after)
    return largest_entry(np.triu(np.abs(relative - relative.T)))


def _correlated(of: FaultyStep) -> tuple[int, int]:
    return largest_entry(np.triu(np.abs(scaled_covariances(of.after)), 1))


def _origin(make: Make, scans: Sequence[Scan], size: Measure, in_prediction: Blame) -> FaultyStep | None:
    """Give scans to a fresh tracker until a covariance is wrong or the step fails; then predict alone to that scan."""
    session, before = TrackerSession(make), None
    for k, scan in enumerate(scans):
        after, failed = _covariance(session.step, scan)
        if not failed and (after is None or size(scaled_covariances(after)) <= ROUNDING):
            before = after
            continue
        if before is None:
            return None if after is None else FaultyStep("start", scan, None, after)
        predicted = after
        if scan.valid:
            predicted = _covariance(TrackerSession.after(make, scans[:k]).peek, empty_scan(scan))[0]
        if predicted is not None and in_prediction(before, predicted, after):
            return FaultyStep("prediction", scan, before, predicted)
        return None if after is None else FaultyStep("update", scan, predicted, after)
    return None


def _covariance(step: Callable[[Scan], Estimate | None], scan: Scan) -> tuple[Array | None, bool]:
    """The covariance, if there is a finite one, and whether the step failed."""
    try:
        estimate = step(scan)
    except StepFailed:
        return None, True
    return (estimate.covariance if estimate is not None and finite(estimate) else None), False

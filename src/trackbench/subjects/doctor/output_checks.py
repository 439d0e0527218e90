"""Checks of every estimate: finite numbers, a symmetric positive definite covariance, and the step that breaks it."""

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

#: Asymmetry or negative eigenvalue beyond rounding, of a covariance scaled to unit variances.
ROUNDING = 1e-6


@contextmanager
def without_warnings() -> Iterator[None]:
    """Suppress warnings of numbers that are not finite: the checks look for such numbers."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@dataclass(frozen=True)
class WorstCase:
    """Place and time of the estimate that violates one check of all estimates most, and by how much."""

    size: float
    where: str
    """Name of the probe (a target for single measurements) or test drive in which the worst case occurred."""
    time: float
    """Time of the estimate, s."""
    sensor: str
    scans: Callable[[], Sequence[Scan]]
    """Returns all scans that the tracker was given up to ``time``, without batch axes."""


class OutputChecks:
    """Counter of all estimates of an examination, which keeps the worst estimate for each check."""

    def __init__(self) -> None:
        self.estimates = 0
        self.indefinite_estimates = 0
        self.not_finite: WorstCase | None = None
        """First estimate with a value that is not finite; None for no such estimate."""
        self.asymmetry: WorstCase | None = None
        """Estimate with the largest difference of mirrored covariance entries, divided by their standard deviations."""
        self.indefinite: WorstCase | None = None
        """Estimate with the smallest eigenvalue of the covariance scaled to unit variances; ``size``: its negative."""

    def add(self, estimate: Estimate | None, scan: Scan, where: str, scans: Sequence[Scan]) -> None:
        """Check the estimate after ``scan``, the last of all ``scans`` of the tracker; None is not counted."""
        count = len(scans)
        if estimate is not None:
            mean, covariance = estimate.mean[:, None], estimate.covariance[..., None]
            self.add_batch(mean, covariance, [scan], where, lambda _: scans[:count])

    def add_track(self, estimates: Sequence[Estimate | None], scans: Sequence[Scan], where: str) -> None:
        """Check the estimates of a track, one for each scan; None is not counted."""
        pairs = [(k, estimate) for k, estimate in enumerate(estimates) if estimate is not None]
        if pairs:
            mean = np.stack([estimate.mean for _, estimate in pairs], axis=-1)
            covariance = np.stack([estimate.covariance for _, estimate in pairs], axis=-1)
            self.add_batch(mean, covariance, [scans[k] for k, _ in pairs], where, lambda i: scans[: pairs[i][0] + 1])

    def add_batch(
        self,
        mean: Array,
        covariance: Array,
        scans: Sequence[Scan],
        where: str,
        scans_until: Callable[[int], Sequence[Scan]],
    ) -> None:
        """Check estimates ``(4, n)`` and ``(4, 4, n)``, each after its scan.

        ``scans_until(i)`` returns the scans of the run of estimate ``i`` up to its own scan.
        """
        self.estimates += mean.shape[1]
        finite = np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1))
        if not finite.all() and self.not_finite is None:
            first = int(np.argmin(finite))
            self.not_finite = _case(1.0, scans[first], where, partial(scans_until, first))
        finite_columns = np.flatnonzero(finite)
        if len(finite_columns) == 0:
            return
        relative = scaled_covariances(np.moveaxis(covariance[:, :, finite_columns], -1, 0))
        asymmetries, least = asymmetry(relative), least_eigenvalue(relative)
        self.indefinite_estimates += int(np.sum(least < -ROUNDING))
        most, lowest = int(finite_columns[np.argmax(asymmetries)]), int(finite_columns[np.argmin(least)])
        largest, smallest = float(asymmetries.max()), float(least.min())
        if self.asymmetry is None or largest > self.asymmetry.size:
            self.asymmetry = _case(largest, scans[most], where, partial(scans_until, most))
        if self.indefinite is None or -smallest > self.indefinite.size:
            self.indefinite = _case(-smallest, scans[lowest], where, partial(scans_until, lowest))


def scaled_covariances(p: Array, like: Array | None = None) -> Array:
    """Return covariances ``(..., 4, 4)`` scaled to unit variances, or by the standard deviations of ``like``."""
    variances = np.abs(np.diagonal(p if like is None else like, axis1=-2, axis2=-1))
    scale = np.sqrt(np.maximum(variances, np.finfo(float).tiny))
    return np.asarray(p / (scale[..., :, None] * scale[..., None, :]))


def asymmetry(relative: Array) -> Array:
    """Return the largest difference of mirrored entries of each scaled covariance ``(..., 4, 4)``."""
    return np.asarray(np.abs(relative - np.swapaxes(relative, -2, -1)).max(axis=(-2, -1)))


def least_eigenvalue(relative: Array) -> Array:
    """Return the least eigenvalue of the symmetric part of each scaled covariance ``(..., 4, 4)``."""
    return np.asarray(np.linalg.eigvalsh(0.5 * (relative + np.swapaxes(relative, -2, -1)))[..., 0])


def _case(size: float, scan: Scan, where: str, scans: Callable[[], Sequence[Scan]]) -> WorstCase:
    return WorstCase(size, where, scan.time, scan.sensor, scans)


Make = Callable[[], Tracker]
Measure = Callable[[Array], Array]
Blame = Callable[[Array, Array, Array | None], bool]
"""Returns whether the prediction is to blame, from the covariances before it, after it and after the update."""


class FaultyStep(NamedTuple):
    """First step of a track that makes its covariance wrong."""

    step: Literal["start", "prediction", "update"]
    scan: Scan
    before: Array | None
    """Covariance ``(4, 4)`` before the step: of the last estimate for a prediction, the predicted one for an update."""
    after: Array
    """First wrong covariance ``(4, 4)``."""

    @property
    def words(self) -> str:
        """The step, its sensor and its time, in words for evidence."""
        if self.step == "start":
            return f"in the first estimate, at {self.scan.time:.4g} s"
        sensor = f" with {self.scan.sensor}" if self.step == "update" else ""
        # The prediction is unknown for a tracker that is given no scans without a detection.
        step = "step" if self.before is None else self.step
        return f"in the {step}{sensor} at {self.scan.time:.4g} s"


def first_asymmetric_step(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """Return the step after which the covariance is first not symmetric; None where there is none."""

    def prediction_adds_more(before: Array, predicted: Array, after: Array | None) -> bool:
        first, then = (asymmetry(scaled_covariances(p, like=predicted)) for p in (before, predicted))
        return bool(
            then > ROUNDING
            and (after is None or then - first >= asymmetry(scaled_covariances(after, like=predicted)) - then)
        )

    return _first_faulty_step(make, scans, asymmetry, prediction_adds_more)


def first_indefinite_step(make: Make, scans: Sequence[Scan]) -> FaultyStep | None:
    """Return the step after which the covariance is first not positive definite; None where there is none."""

    def prediction_is_indefinite(_before: Array, predicted: Array, _after: Array | None) -> bool:
        # An update keeps a covariance positive definite only if the predicted one is.
        return bool(least_eigenvalue(scaled_covariances(predicted)) < -ROUNDING)

    return _first_faulty_step(make, scans, lambda relative: -least_eigenvalue(relative), prediction_is_indefinite)


def fault_of_step(fault: str, faulty: FaultyStep | None) -> str:
    """Return the name of the fault, with ``predicted_`` before it if the fault arises in a prediction."""
    return f"predicted_{fault}" if faulty is not None and faulty.step == "prediction" else fault


def mirrored_entries(faulty: FaultyStep) -> str:
    """Return as text the two mirrored entries that differ most, after the step and before it."""
    i, j = _mirrored(faulty)
    row, column, before, after = COMMON_STATE[i], COMMON_STATE[j], faulty.before, faulty.after
    text = f"row {row}, column {column} is {after[i, j]:.6g} and row {column}, column {row} {after[j, i]:.6g}"
    return text if before is None else f"{text} ({before[i, j]:.6g} and {before[j, i]:.6g} before it)"


def indefinite_entries(faulty: FaultyStep) -> str:
    """Return as text the covariance's least eigenvalue, and a negative variance or a correlation beyond one."""
    variances = np.diag(faulty.after)
    relative = scaled_covariances(faulty.after)
    i, j = _correlated(faulty)
    text = f"the smallest eigenvalue, scaled to unit variances, is {least_eigenvalue(relative):.3g}"
    if faulty.before is not None:
        text += f" ({least_eigenvalue(scaled_covariances(faulty.before)):.3g} before it)"
    if variances.min() < 0.0:
        worst = int(np.argmin(variances))
        return f"{text}; the variance of {COMMON_STATE[worst]} is {variances[worst]:.3g}"
    if abs(relative[i, j]) > 1.0:
        return f"{text}; the correlation of {COMMON_STATE[i]} and {COMMON_STATE[j]} is {relative[i, j]:.4g}"
    return text


def _mirrored(faulty: FaultyStep) -> tuple[int, int]:
    relative = scaled_covariances(faulty.after)
    return largest_entry(np.triu(np.abs(relative - relative.T)))


def _correlated(faulty: FaultyStep) -> tuple[int, int]:
    return largest_entry(np.triu(np.abs(scaled_covariances(faulty.after)), 1))


def _first_faulty_step(make: Make, scans: Sequence[Scan], size: Measure, in_prediction: Blame) -> FaultyStep | None:
    """Step a fresh tracker until a covariance is wrong or a step fails; blame the prediction or the update in it."""
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
    """Return the covariance after a scan, None unless the estimate is finite, and whether the step failed."""
    try:
        estimate = step(scan)
    except StepFailed:
        return None, True
    return (estimate.covariance if estimate is not None and finite(estimate) else None), False

"""A tracker stepped through all scans of a test drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan, scan_of_member
from trackbench.driving.alone import Stateful
from trackbench.subjects.doctor.output_checks import OutputChecks
from trackbench.subjects.doctor.session import Examined, StepFailed, TrackerSession
from trackbench.trackers.answers import Tracker, shaped


class Rollout(NamedTuple):
    """The estimates after each scan, NaN where there is none."""

    mean: Array
    """``(4, scans, runs)``"""
    covariance: Array
    """``(4, 4, scans, runs)``"""
    given: Mask
    """``(scans, runs)``: whether the tracker returned an estimate."""


def rollout(
    make: Callable[[], Tracker], scans: Sequence[Scan], checks: OutputChecks | None = None, drive: str = ""
) -> Rollout:
    """Step a fresh tracker (one for each run unless it is batched) through scans with the batch axis ``(runs,)``.

    Raises:
        StepFailed: the tracker raised, or returned no valid estimate.
    """
    batched = bool(getattr(make(), "batched", False))
    estimates = _batched(make, scans) if batched else _one_by_one(make, scans)
    if checks is not None:
        k, run = np.nonzero(estimates.given)

        def scans_of_run(i: int) -> list[Scan]:
            """From its first measurement on."""
            own = [scan_of_member(scan, int(run[i])) for scan in scans[: k[i] + 1]]
            return own[next(first for first, scan in enumerate(own) if scan.valid) :]

        mean, covariance = estimates.mean[:, k, run], estimates.covariance[:, :, k, run]
        checks.add_batch(mean, covariance, [scans[int(i)] for i in k], drive, scans_of_run)
    return estimates


def _batched(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Rollout:
    tracker, estimates = Stateful(make(), shaped), _empty(scans)
    on_step = Examined.of(make).on_step
    for k, scan in enumerate(scans):
        try:
            estimate = tracker.step(scan)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            # If it fails in one run alone, that failure is raised.
            _one_by_one(make, scans[: k + 1])
            raise StepFailed(error, scan_of_member(scan, 0)) from error
        on_step()
        if estimate is not None:
            estimates.mean[:, k], estimates.covariance[:, :, k] = estimate.mean, estimate.covariance
            # A batched tracker returns NaN for a track that has not started.
            estimates.given[k] = ~np.isnan(estimate.mean).all(axis=0) | (k > 0 and estimates.given[k - 1])
    return estimates


def _one_by_one(make: Callable[[], Tracker], scans: Sequence[Scan]) -> Rollout:
    estimates = _empty(scans)
    for run in range(scans[0].valid.size):
        first = next((k for k, scan in enumerate(scans) if scan.valid[run]), len(scans))
        own = [scan_of_member(scan, run) for scan in scans[first:]]
        for k, estimate in enumerate(TrackerSession(make).walk(own) if own else [], start=first):
            if estimate is not None:
                estimates.mean[:, k, run], estimates.covariance[:, :, k, run] = estimate.mean, estimate.covariance
                estimates.given[k, run] = True
    return estimates


def _empty(scans: Sequence[Scan]) -> Rollout:
    shape: Any = (len(scans), scans[0].valid.size)
    return Rollout(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan), np.zeros(shape, dtype=bool))

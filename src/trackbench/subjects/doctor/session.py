"""A session: a tracker that follows one target, and can be tried on a scan without being changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Scan, scan_of_member
from trackbench.driving.drive import empty_scan
from trackbench.driving.faults import fault_of
from trackbench.driving.program import ProgramTracker
from trackbench.subjects.doctor.copyable_tracker import CopyableTracker
from trackbench.trackers.answers import TOO_LARGE, Tracker, TrackerFault

#: Largest value and standard deviation of an estimate of any target, m and m/s; a larger one is a fault.
LARGEST = 1e9
#: Value beyond which a track has diverged, m and m/s: no target of a probe or drive is so far or so fast.
FAR = 1e4
#: Reason why a check is not made with a tracker that gives no prediction.
NO_PREDICTION = (
    "it needs the tracker's prediction, and at a missed scan the tracker returns None; predict there and return the "
    "estimate, or state by --no-misses that there are no missed scans"
)


class StepFailed(Exception):
    """A step in which the tracker raised an error, or returned no valid estimate.

    Args:
        error: error that the step raised.
        scan: scan of the step.
        earlier_scans: scans before the failed one, in order.
    """

    def __init__(self, error: BaseException, scan: Scan, earlier_scans: Sequence[Scan] = ()) -> None:
        self.fault = fault_of(error)
        super().__init__(self.fault.cause)
        self.scan = scan
        self.earlier_scans = tuple(earlier_scans)


class MissGiven(StepFailed):
    """Error raised in place of a step at a scan without a detection, which the user excludes for the tracker."""

    def __init__(self, scan: Scan) -> None:
        super().__init__(TrackerFault("it is given no scans without a detection"), scan)


def do_nothing() -> None:
    """Do nothing, as the step counter where nobody counts steps."""


@dataclass(frozen=True)
class TrackerFactory:
    """Maker of fresh trackers, with a rule for scans without a detection, and a counter of steps."""

    make: Callable[[], Tracker]
    no_misses: bool = False
    """Whether the trackers are given no scan without a detection."""
    on_step: Callable[[], None] = do_nothing

    def __call__(self) -> Tracker:
        return self.make()

    @classmethod
    def of(cls, make: Callable[[], Tracker]) -> TrackerFactory:
        """Return ``make`` if it is a factory, or a factory of it that allows missed scans and counts no steps."""
        return make if isinstance(make, TrackerFactory) else cls(make)


class TrackerSession:
    """A fresh tracker that follows one target; its scans and estimates have no batch axes.

    ``peek`` steps a copy of the tracker and of its state, because some trackers keep their state in the instance.

    Args:
        make: makes a fresh tracker.
        columns: number of targets that a batched tracker follows at once, each in a column of its batch.
    """

    def __init__(self, make: Callable[[], Tracker], columns: int = 1) -> None:
        self._tracker = CopyableTracker(make)
        factory = TrackerFactory.of(make)
        self._no_misses, self._on_step = factory.no_misses, factory.on_step
        self._batched = self._tracker.batched
        self._started = [False] * (columns if self._batched else 1)

    @classmethod
    def after(cls, make: Callable[[], Tracker], scans: Sequence[Scan]) -> TrackerSession:
        """Return a session of a fresh tracker that has processed ``scans``; raise ``StepFailed`` where a step fails."""
        session = cls(make)
        session.follow(scans)
        return session

    @property
    def columns(self) -> int:
        """Number of targets that the session follows; 1 for a tracker that takes no batch."""
        return len(self._started)

    @property
    def scans(self) -> list[Scan]:
        """Scans that the first member of the tracker's batch has been given."""
        return self.scans_of(0)

    def scans_of(self, column: int) -> list[Scan]:
        """Return the scans that the batch member with the index ``column`` has been given."""
        return [scan_of_member(scan, column) for scan in self._tracker.scans] if self._batched else self._tracker.scans

    @property
    def not_copied(self) -> str | None:
        """Reason why a copy is a fresh tracker given all scans again; None while ``copy.deepcopy`` has not failed."""
        return self._tracker.not_copied

    def step(self, scan: Scan) -> Estimate | None:
        """Give a scan to all columns and return the first column's estimate; None before its track has started.

        Raises:
            StepFailed: the tracker raised, or returned no valid estimate.
            MissGiven: the scan has no detection, and the tracker is given only scans with one.
        """
        return self.step_each([scan] * self.columns)[0]

    def step_each(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """Return the estimate of each column after its scan; all scans are of one sensor and instant.

        Raises:
            StepFailed: the tracker raised, or returned no valid estimate, in any column.
            MissGiven: a scan has no detection, and the tracker is given only scans with one.
        """
        if self._no_misses and not all(scan.valid.any() for scan in scans):
            raise MissGiven(scans[0])
        scan = _stack_columns(scans) if self._batched else scans[0]
        earlier = len(self._tracker.scans)
        try:
            answer = self._tracker.step(scan)
            _refuse_huge(answer)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise StepFailed(error, scans[0], self.scans[:earlier]) from error
        finally:
            self._on_step()
        estimates = [self._column_of(answer, column) for column in range(self.columns)]
        self._started = [was or now is not None for was, now in zip(self._started, estimates, strict=True)]
        return estimates

    def walk(self, scans: Sequence[Scan]) -> Iterator[Estimate | None]:
        """Yield the estimate after each scan; raise ``StepFailed`` where a step fails."""
        yield from (self.step(scan) for scan in scans)

    def follow(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """Step through all scans; return the estimate after each, and raise ``StepFailed`` where a step fails."""
        return list(self.walk(scans))

    def peek(self, scan: Scan) -> Estimate | None:
        """Return the estimate, or None, that ``step`` would return, without changing the session.

        Raises:
            StepFailed: the step failed, or the tracker can neither be copied nor repeated.
        """
        return self._copy(scan).step(scan)

    @property
    def peek_limit(self) -> int:
        """Largest number of scans that ``peek_each`` takes; 1 where the columns of the batch differ."""
        return self.columns if self._columns_agree else 1

    def peek_each(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """Return the estimate that ``peek`` would return for each of at most ``peek_limit`` scans.

        All scans are of one sensor and instant.

        Raises:
            StepFailed: a step failed, or the tracker can neither be copied nor repeated.
        """
        padding = [scans[0]] * (self.columns - len(scans))
        return self._copy(scans[0]).step_each([*scans, *padding])[: len(scans)]

    @property
    def inside(self) -> tuple[Any, Any] | None:
        """Tracker and its state, to search for values; a wrapper gives its attribute ``within``; None for a program."""
        tracker, state = self._tracker.tracker, self._tracker.state
        return None if isinstance(tracker, ProgramTracker) else (getattr(tracker, "within", tracker), state)

    @property
    def _columns_agree(self) -> bool:
        latest = self._tracker.latest
        return latest is None or all(bool(np.all(part == part[..., :1])) for part in (latest.mean, latest.covariance))

    def predict(self, scan: Scan) -> Estimate | None:
        """Return the estimate at the time of a scan, before its measurement: the answer to a missed scan.

        Where no missed scan may be given, the last estimate (None without one) is moved by its velocity, without noise.

        Raises:
            StepFailed: the step failed, or the tracker can neither be copied nor repeated.
        """
        if not self._no_misses:
            return self.peek(empty_scan(scan))
        latest = self._column_of(self._tracker.latest, 0)
        if latest is None:
            return None
        transition = np.eye(4)
        transition[0, 2] = transition[1, 3] = scan.time - self._tracker.scans[-1].time
        return Estimate(transition @ latest.mean, transition @ latest.covariance @ transition.T, latest.state)

    def copy(self) -> TrackerSession:
        """Return an independent session with the same state; raise ``StepFailed`` where none can be made."""
        return self._copy(self.scans[-1])

    def _copy(self, scan: Scan) -> TrackerSession:
        twin = TrackerSession.__new__(TrackerSession)
        twin._batched, twin._started = self._batched, list(self._started)
        twin._no_misses, twin._on_step = self._no_misses, self._on_step
        try:
            twin._tracker = self._tracker.copy()
        except Exception as error:
            raise StepFailed(error, scan, self.scans) from error
        return twin

    def _column_of(self, estimate: Estimate | None, column: int) -> Estimate | None:
        if estimate is None or not self._batched:
            return estimate
        mean, covariance, state = estimate.mean[..., column], estimate.covariance[..., column], estimate.state
        # A batched tracker returns NaN for a track that has not started.
        if not self._started[column] and np.isnan(mean).all():
            return None
        return Estimate(mean, covariance, None if state is None else state[..., column])


def _refuse_huge(estimate: Estimate | None) -> None:
    if estimate is not None:
        parts = (estimate.mean, np.sqrt(np.abs(estimate.covariance)))
        if LARGEST < max(float(np.abs(part).max(initial=0.0)) for part in parts) < np.inf:
            raise TrackerFault(TOO_LARGE)


def finite(estimate: Estimate) -> bool:
    """Return whether mean and covariance are finite."""
    return bool(np.isfinite(estimate.mean).all() and np.isfinite(estimate.covariance).all())


def position_sigma(estimate: Estimate) -> float:
    """Return the RMS position error that the estimate's covariance states, m."""
    return float(np.sqrt(np.trace(estimate.covariance[:2, :2])))


def plausible(estimate: Estimate | None) -> bool:
    """Return whether the estimate exists and is finite, with values and standard deviations below 10 000 m or m/s."""
    if estimate is None or not finite(estimate):
        return False
    return bool(np.abs(estimate.mean).max() < FAR and np.abs(np.diag(estimate.covariance)).max() < FAR**2)


def largest_difference(estimate: Estimate, reference: Estimate) -> float:
    """Return the largest difference of two estimates' entries, scaled by the standard deviations of ``reference``."""
    sigma = np.sqrt(np.maximum(np.diag(reference.covariance), np.finfo(float).tiny))
    mean = np.abs(estimate.mean - reference.mean) / sigma
    covariance = np.abs(estimate.covariance - reference.covariance) / np.outer(sigma, sigma)
    return float(np.maximum(mean.max(), covariance.max()))


def _stack_columns(scans: Sequence[Scan]) -> Scan:
    measurement = np.stack([scan.measurement for scan in scans], axis=-1)
    return scans[0]._replace(measurement=measurement, valid=np.stack([scan.valid for scan in scans], axis=-1))

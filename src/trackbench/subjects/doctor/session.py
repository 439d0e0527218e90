"""A tracker that follows one target, and can be tried on a scan without being changed."""

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

#: An estimate or a standard deviation beyond this is one of no target, m and m/s.
LARGEST = 1e9
#: Beyond this a track has diverged: no target of a probe or drive is so far or so fast, m and m/s.
FAR = 1e4
#: Why a check is not made.
NO_PREDICTION = (
    "it needs the tracker's prediction, and at a missed scan the tracker returns None; predict there and return the "
    "estimate, or state by --no-misses that there are no missed scans"
)


class StepFailed(Exception):
    """A tracker raised, or what it returned is no estimate.

    Args:
        error: what it raised.
        scan: that of the step.
        given: the scans before it.
    """

    def __init__(self, error: BaseException, scan: Scan, given: Sequence[Scan] = ()) -> None:
        self.fault = fault_of(error)
        super().__init__(self.fault.cause)
        self.scan = scan
        self.given = tuple(given)


class MissGiven(StepFailed):
    """A tracker that may assume that every scan has a detection would be given another one; it is not."""

    def __init__(self, scan: Scan) -> None:
        super().__init__(TrackerFault("it is given no scans without a detection"), scan)


def not_counted() -> None:
    """Of a step that nobody counts."""


@dataclass(frozen=True)
class Examined:
    """Gives fresh trackers, and says how they are stepped."""

    make: Callable[[], Tracker]
    no_misses: bool = False
    """Whether they are given no scan without a detection."""
    on_step: Callable[[], None] = not_counted
    """Called after each step."""

    def __call__(self) -> Tracker:
        return self.make()

    @classmethod
    def of(cls, make: Callable[[], Tracker]) -> Examined:
        """What gives such trackers already, or any other function as it is."""
        return make if isinstance(make, Examined) else cls(make)


class TrackerSession:
    """A fresh tracker that follows one target; scans and estimates have no batch axes.

    ``peek`` steps a copy of the tracker and of its state, because some trackers keep their state in the instance.

    Args:
        make: gives a fresh tracker.
        columns: how many targets one that takes a batch follows at once, each in a column of its own.
    """

    def __init__(self, make: Callable[[], Tracker], columns: int = 1) -> None:
        self._own = CopyableTracker(make)
        how = Examined.of(make)
        self._no_misses, self._on_step = how.no_misses, how.on_step
        self._batched = self._own.batched
        self._started = [False] * (columns if self._batched else 1)

    @classmethod
    def after(cls, make: Callable[[], Tracker], scans: Sequence[Scan]) -> TrackerSession:
        """A session that has been given some scans.

        Raises:
            StepFailed: as of ``walk``.
        """
        session = cls(make)
        session.follow(scans)
        return session

    @property
    def columns(self) -> int:
        """How many targets it follows: one where the tracker takes no batch."""
        return len(self._started)

    @property
    def given(self) -> list[Scan]:
        """The scans so far, those of the first column."""
        return self.given_to(0)

    def given_to(self, column: int) -> list[Scan]:
        """The scans so far of one column."""
        return [scan_of_member(scan, column) for scan in self._own.given] if self._batched else self._own.given

    @property
    def not_copied(self) -> str | None:
        """Why a copy is a fresh tracker that is given the same scans again; None where it is not, or none was made."""
        return self._own.not_copied

    def step(self, scan: Scan) -> Estimate | None:
        """The estimate after a scan, which all columns are given; None before the track has started.

        Raises:
            StepFailed: the tracker raised, or returned no valid estimate.
            MissGiven: the scan has no detection, and it may not be given.
        """
        return self.step_each([scan] * self.columns)[0]

    def step_each(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """The estimates after a scan for each column, all of one sensor and instant.

        Raises:
            StepFailed: as of ``step``, in any column.
            MissGiven: as of ``step``.
        """
        if self._no_misses and not all(scan.valid.any() for scan in scans):
            raise MissGiven(scans[0])
        given = _side_by_side(scans) if self._batched else scans[0]
        before = len(self._own.given)
        try:
            estimate = self._own.step(given)
            _require_small(estimate)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise StepFailed(error, scans[0], self.given[:before]) from error
        finally:
            self._on_step()
        found = [self._of(estimate, column) for column in range(self.columns)]
        self._started = [had or one is not None for had, one in zip(self._started, found, strict=True)]
        return found

    def walk(self, scans: Sequence[Scan]) -> Iterator[Estimate | None]:
        """Yield the estimates after each of some scans.

        Raises:
            StepFailed: as of ``step``.
        """
        yield from (self.step(scan) for scan in scans)

    def follow(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """The estimates after all of some scans.

        Raises:
            StepFailed: as of ``walk``.
        """
        return list(self.walk(scans))

    def peek(self, scan: Scan) -> Estimate | None:
        """What ``step`` would return, without changing the session.

        Raises:
            StepFailed: as of ``step``, or the tracker can neither be copied nor repeated.
        """
        return self._copied(scan).step(scan)

    @property
    def at_once(self) -> int:
        """How many scans of one sensor and instant ``peek_each`` may be given."""
        return self.columns if self._alike else 1

    def peek_each(self, scans: Sequence[Scan]) -> list[Estimate | None]:
        """What ``peek`` would return of each of at most ``at_once`` scans, of one sensor and instant.

        Raises:
            StepFailed: as of ``peek``, at any of them.
        """
        more = [scans[0]] * (self.columns - len(scans))
        return self._copied(scans[0]).step_each([*scans, *more])[: len(scans)]

    @property
    def inside(self) -> tuple[Any, Any] | None:
        """The tracker, or the one within it that it says, and its state; None of one that lives elsewhere."""
        tracker = self._own.tracker
        return None if isinstance(tracker, ProgramTracker) else (getattr(tracker, "within", tracker), self._own.state)

    @property
    def _alike(self) -> bool:
        """Whether all columns have the same estimate, to the last bit."""
        latest = self._own.latest
        return latest is None or all(bool(np.all(part == part[..., :1])) for part in (latest.mean, latest.covariance))

    def predict(self, scan: Scan) -> Estimate | None:
        """The estimate at the time of a scan before its measurement: that at a missed measurement then.

        Where none may be given, the last estimate moved by its own velocity, without process noise.

        Raises:
            StepFailed: as of ``peek``.
        """
        if not self._no_misses:
            return self.peek(empty_scan(scan))
        latest = self._of(self._own.latest, 0)
        if latest is None:
            return None
        transition = np.eye(4)
        transition[0, 2] = transition[1, 3] = scan.time - self._own.given[-1].time
        return Estimate(transition @ latest.mean, transition @ latest.covariance @ transition.T, latest.state)

    def copy(self) -> TrackerSession:
        """An independent session with the same state.

        Raises:
            StepFailed: the tracker can neither be copied nor repeated.
        """
        return self._copied(self.given[-1])

    def _copied(self, scan: Scan) -> TrackerSession:
        twin = TrackerSession.__new__(TrackerSession)
        twin._batched, twin._started = self._batched, list(self._started)
        twin._no_misses, twin._on_step = self._no_misses, self._on_step
        try:
            twin._own = self._own.copy()
        except Exception as error:
            raise StepFailed(error, scan, self.given) from error
        return twin

    def _of(self, estimate: Estimate | None, column: int) -> Estimate | None:
        if estimate is None or not self._batched:
            return estimate
        mean, covariance, own = estimate.mean[..., column], estimate.covariance[..., column], estimate.state
        # A batched tracker returns NaN for a track that has not started.
        if not self._started[column] and np.isnan(mean).all():
            return None
        return Estimate(mean, covariance, None if own is None else own[..., column])


def _require_small(estimate: Estimate | None) -> None:
    """Refuse one of no target: no target of a probe can be so far or so little known."""
    if estimate is not None:
        parts = (estimate.mean, np.sqrt(np.abs(estimate.covariance)))
        if LARGEST < max(float(np.abs(part).max(initial=0.0)) for part in parts) < np.inf:
            raise TrackerFault(TOO_LARGE)


def finite(estimate: Estimate) -> bool:
    """Whether mean and covariance are finite."""
    return bool(np.isfinite(estimate.mean).all() and np.isfinite(estimate.covariance).all())


def position_sigma(estimate: Estimate) -> float:
    """Standard deviation of the distance from the estimated position, m."""
    return float(np.sqrt(np.trace(estimate.covariance[:2, :2])))


def plausible(estimate: Estimate | None) -> bool:
    """Whether it is finite, and its values and standard deviations are below `FAR`: the track has not diverged."""
    if estimate is None or not finite(estimate):
        return False
    return bool(np.abs(estimate.mean).max() < FAR and np.abs(np.diag(estimate.covariance)).max() < FAR**2)


def apart(one: Estimate, other: Estimate) -> float:
    """The largest difference of two estimates: of the means in the other's standard deviations, of the covariances in
    its variances."""
    sigma = np.sqrt(np.maximum(np.diag(other.covariance), np.finfo(float).tiny))
    mean = np.abs(one.mean - other.mean) / sigma
    covariance = np.abs(one.covariance - other.covariance) / np.outer(sigma, sigma)
    return float(np.maximum(mean.max(), covariance.max()))


def _side_by_side(scans: Sequence[Scan]) -> Scan:
    """One scan with a column of each."""
    measurement = np.stack([scan.measurement for scan in scans], axis=-1)
    return scans[0]._replace(measurement=measurement, valid=np.stack([scan.valid for scan in scans], axis=-1))

"""Scans that are older than a tracker's state (out-of-sequence measurements): history, replay and retrodiction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Scan
from trackbench.base.units import difference
from trackbench.engine.choice import Engine
from trackbench.filters import Belief, Filter, SingleModelFilter, Update
from trackbench.filters.base import correct, guarded
from trackbench.models.motion import MotionModel, process_noise_covariance
from trackbench.trackers.assume import AssumedSensors
from trackbench.trackers.config import AdvanceAt, LateMethod
from trackbench.trackers.initial import InitialConfig


class Timed(Protocol):
    """A state with a time."""

    @property
    def time(self) -> float:
        """Of the latest processed scan, s."""
        ...


S = TypeVar("S", bound=Timed)
A = TypeVar("A")
#: Processes a scan at its time, given the origins of its detections: the state and the answer after it.
Step = Callable[[S, Scan, Indices | None], tuple[S, A]]


class ProcessedScan(NamedTuple, Generic[S, A]):
    """A scan in the history. It is never changed, so that a copied state shares its history."""

    before: S
    """The state before it."""
    scan: Scan
    origins: Indices | None = None
    """Of its detections, for the tracker that knows them."""
    answer: A | None = None
    """The estimate or tracks after it; None where they are not needed."""
    outdated: bool = False
    """Whether a late scan of an earlier time was processed since, so that ``before`` lacks it."""

    def __deepcopy__(self, memo: dict[int, Any]) -> ProcessedScan[S, A]:
        return self


class Replayed(NamedTuple, Generic[S, A]):
    """The result of going back to a late scan's time and processing all later scans again."""

    state: S
    late: A
    """The answer after the late scan."""
    latest: A
    """The answer after the latest scan."""
    history: tuple[ProcessedScan[S, A], ...]


def appended(
    step: Step[S, A], history: tuple[ProcessedScan[S, A], ...], processed: ProcessedScan[S, A], lag: float
) -> tuple[ProcessedScan[S, A], ...]:
    """The history with one more scan, and without those that are older than it by more than ``lag`` seconds."""
    first = bisect_left(history, processed.scan.time - lag, key=lambda earlier: earlier.scan.time)
    if first == len(history):
        return (processed,)
    return (*up_to_date(step, history, first)[first:], processed)


def position(history: tuple[ProcessedScan[S, A], ...], scan: Scan) -> int | None:
    """Index at which a late scan belongs in the history.

    None where the scan is not late, or where the history does not reach back so far. Scans of one time are in the
    order in which they are delivered when nothing is late.
    """
    if not history or _order(history[-1].scan) <= _order(scan):
        return None
    number = sum(_order(processed.scan) <= _order(scan) for processed in history)
    if number == 0 and history[0].before.time > scan.time:
        return None
    return number


def _order(scan: Scan) -> tuple[float, int]:
    return scan.time, scan.place


def up_to_date(
    step: Step[S, A], history: tuple[ProcessedScan[S, A], ...], number: int
) -> tuple[ProcessedScan[S, A], ...]:
    """The history with no outdated state up to the scan of this index."""
    redone: list[ProcessedScan[S, A]] = []
    for processed in history[: number + 1]:
        if processed.outdated:
            last = redone[-1]
            processed = processed._replace(before=step(last.before, last.scan, last.origins)[0], outdated=False)
        redone.append(processed)
    return (*redone, *history[number + 1 :])


def replayed(
    step: Step[S, A], history: tuple[ProcessedScan[S, A], ...], number: int, scan: Scan, origins: Indices | None = None
) -> Replayed[S, A]:
    """Process a late scan at its index in the history, and the later ones again."""
    before = history[number].before
    state, late = step(before, scan, origins)
    redone, latest = [ProcessedScan(before, scan, origins, late)], late
    for processed in history[number:]:
        before = state
        state, latest = step(before, processed.scan, processed.origins)
        redone.append(ProcessedScan(before, processed.scan, processed.origins, latest))
    return Replayed(state, late, latest, (*history[:number], *redone))


class Retrodiction(NamedTuple):
    """What a filter believed before a late measurement was taken, and believes now."""

    before: Belief
    """After the latest scan that was taken before it."""
    time: float
    """Of that scan, s."""
    now: Belief
    times: tuple[float, ...]
    """Of all scans that were taken since the late one; the last is that of ``now``, s."""


def retrodicted(filter: SingleModelFilter, beliefs: Retrodiction, scan: Scan) -> Update[Belief]:
    """The present belief with a late measurement, without taking later ones in again.

    All measurements since ``beliefs.before`` count as one equivalent measurement at the present, which the two beliefs
    tell; with it the state and the process noise go back to the late measurement's time. With one measurement in
    between and a linear model this is the optimal algorithm A1, with more Al1, which is nearly so. The process noise is
    that of the steps between the measurements. A nonlinear model is linearised at the present mean, and its transition
    taken over a negative time.

    Source: Bar-Shalom (2002), "Update with out-of-sequence measurements in tracking: exact solution", equations 18 to
    35; Bar-Shalom, Chen and Mallick (2004), "One-step solution for the multistep out-of-sequence-measurement problem in
    tracking", section III.
    """
    motion, now = filter.motion, beliefs.now
    back = beliefs.times[-1] - scan.time
    ahead = beliefs.before
    for start, end in pairwise((beliefs.time, *beliefs.times)):
        ahead = filter.predict(Belief(ahead.mean, ahead.covariance), end - start)
    gained = difference(now.mean, ahead.mean, motion.angular)
    inverse = _inverse(ahead.covariance)
    # What the equivalent measurement says: its information, and with it its innovation.
    information = linalg.matmul(linalg.matmul(inverse, ahead.covariance - now.covariance), inverse)
    noise = _noise(motion, now, (scan.time, *beliefs.times))
    pushed = linalg.matvec(linalg.matmul(noise, inverse), gained)
    noise_covariance = noise - linalg.quadratic(noise, information)
    shared = noise - linalg.matmul(linalg.matmul(ahead.covariance, information), noise)
    f = np.broadcast_to(linalg.expand(motion.jacobian(now.mean, -back), now.covariance), now.covariance.shape)
    with_past = linalg.matmul_transposed(now.covariance - shared, f)
    spread = now.covariance + noise_covariance - shared - np.swapaxes(shared, 0, 1)
    past = guarded(Belief(motion.transition(now.mean - pushed, -back), linalg.symmetrise(linalg.quadratic(f, spread))))
    expected, measured = filter.predict_measurement(past, scan), filter.measured(scan)
    # Of the present state: the measurement's cross covariance with the past one, carried there.
    slope = linalg.matmul(expected.cross, _inverse(past.covariance))
    cross = linalg.matmul_transposed(slope, with_past)
    innovation = difference(measured.value, expected.mean, measured.angular)
    s = expected.covariance + linalg.expand(measured.noise, expected.covariance)
    update = correct(now._replace(points=None, factor=None), innovation, s, cross, scan.valid, motion.angular)
    return update._replace(belief=guarded(update.belief))


def _noise(motion: MotionModel, now: Belief, times: tuple[float, ...]) -> Array:
    """``(n, n, ...)`` covariance of the process noise between these times, s, in the state at the last of them."""
    noise = np.zeros_like(now.covariance)
    for start, end in pairwise(times):
        mean = motion.transition(now.mean, start - times[-1])
        added = process_noise_covariance(motion, mean, end - start)
        f = linalg.expand(motion.jacobian(mean, end - start), noise)
        noise = linalg.quadratic(np.broadcast_to(f, noise.shape), noise) + linalg.expand(added, noise)
    return noise


def _inverse(p: Array) -> Array:
    """The inverse of a covariance ``(n, n, ...)``."""
    identity = np.broadcast_to(linalg.expand(np.eye(len(p)), p), p.shape)
    return linalg.gram(linalg.ensure_definite(p).factor.whiten(identity))


@dataclass(frozen=True)
class ScanTracker(ABC):
    """A built-in tracker, of one object or of several: its filter, and how it takes scans."""

    filter: Filter[Any]
    initial: InitialConfig
    assumed: AssumedSensors = field(default_factory=AssumedSensors)
    sensors: Collection[str] | None = None
    """Names of the sensors whose measurements update the tracks; None: all."""
    advance_at: AdvanceAt = "own_scans"
    late: LateMethod = "replay"
    """What becomes of a scan that is older than the state."""
    lag_s: float = 1.0
    """How far back a late scan may reach, s."""
    engine: Engine = "numpy"

    batched: ClassVar = True
    _forgotten: ClassVar[Mapping[str, Any]] = {"history": ()}
    """What a past state that is kept needs no more, and what takes its place."""

    def reads(self, sensor: str) -> bool:
        """Whether the sensor's measurements update or start tracks."""
        return self.sensors is None or sensor in self.sensors or sensor in (self.initial.sensors or ())

    def _after_scan(self, state: Any, scan: Scan, origins: Indices | None = None) -> tuple[Any, Any]:
        """The state and the answer after a scan, late or not, at which the state advances."""
        number = position(state.history, scan)
        if number is not None and (self.late == "replay" or scan.time < state.time):
            return self._after_late(state, scan, origins, number)
        if scan.time < state.time:
            return state, self._present(state)
        before = state._replace(**self._forgotten) if self.lag_s > 0.0 else state
        after, answer = self._in_sequence(before, scan, origins)
        if self.late in ("replay", "retrodiction") and self.lag_s > 0.0:
            processed = ProcessedScan(before, scan, origins, answer)
            after = after._replace(history=appended(self._in_sequence, state.history, processed, self.lag_s))
        return after, answer

    @abstractmethod
    def _in_sequence(self, state: Any, scan: Scan, origins: Indices | None = None) -> tuple[Any, Any]:
        """The state and the answer after a scan that is not older than the state."""

    @abstractmethod
    def _after_late(self, state: Any, scan: Scan, origins: Indices | None, number: int) -> tuple[Any, Any]:
        """The state and the answer after a late scan that belongs at this index of the history."""

    @abstractmethod
    def _present(self, state: Any) -> Any:
        """The answer at the time of the state."""

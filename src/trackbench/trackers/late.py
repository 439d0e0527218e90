"""Scans that are older than a tracker's state (out-of-sequence measurements): the history, and replay."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from trackbench.base.types import Indices, Scan
from trackbench.engine.choice import Engine
from trackbench.filters import Filter
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

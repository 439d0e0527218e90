"""Scans that are older than a tracker's state (out-of-sequence measurements): the history, and replay."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

from trackbench.base.types import Indices, Scan

LateMethod = Literal["drop", "as_new", "replay", "retrodiction"]


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


def inserted(history: tuple[ProcessedScan[S, A], ...], number: int, scan: Scan) -> tuple[ProcessedScan[S, A], ...]:
    """The history, up to date to this index, with a late scan inserted there; the states after it become outdated."""
    late: ProcessedScan[S, A] = ProcessedScan(history[number].before, scan)
    return (*history[:number], late, *(processed._replace(outdated=True) for processed in history[number:]))


def replayed(
    step: Step[S, A],
    history: tuple[ProcessedScan[S, A], ...],
    number: int,
    scan: Scan,
    origins: Indices | None = None,
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

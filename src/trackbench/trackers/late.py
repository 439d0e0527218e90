"""Scans that are older than what a tracker has already taken in: out-of-sequence measurements."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

from trackbench.base.types import Indices, Scan

LateMethod = Literal["drop", "as_new", "replay", "retrodiction"]


class Timed(Protocol):
    """A state that knows when it is of."""

    @property
    def time(self) -> float:
        """Of the latest scan that was taken in, s."""
        ...


S = TypeVar("S", bound=Timed)
A = TypeVar("A")
#: Takes a scan in at its time, given the origins of its detections.
Step = Callable[[S, Scan, Indices | None], tuple[S, A]]


class Taken(NamedTuple, Generic[S, A]):
    """A scan that was taken in. It is never changed, so that a copied state shares its history."""

    before: S
    """The state before it."""
    scan: Scan
    origins: Indices | None = None
    """Of its detections, for the tracker that knows them."""
    said: A | None = None
    """What the tracker said after it, where that may be asked for."""
    outdated: bool = False
    """Whether a late scan has been taken in since, of a time before it, that ``before`` does not hold."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Taken[S, A]:
        return self


class Replayed(NamedTuple, Generic[S, A]):
    """What going back to a late scan's time and taking all later scans in again gave."""

    state: S
    late: A
    """What the tracker said after the late scan."""
    latest: A
    """What it said after the latest scan."""
    history: tuple[Taken[S, A], ...]


def kept(step: Step[S, A], history: tuple[Taken[S, A], ...], taken: Taken[S, A], lag: float) -> tuple[Taken[S, A], ...]:
    """The history with one more scan, and without those that are older than it by more than ``lag`` seconds."""
    first = bisect_left(history, taken.scan.time - lag, key=lambda one: one.scan.time)
    if first == len(history):
        return (taken,)
    return (*up_to_date(step, history, first)[first:], taken)


def position(history: tuple[Taken[S, A], ...], scan: Scan) -> int | None:
    """Where in the history a scan belongs that was taken earlier than its last one.

    None where it was not, or where the history does not reach back so far. Scans of one time are in the order in which
    they are delivered when nothing is late.
    """
    if not history or _order(history[-1].scan) <= _order(scan):
        return None
    number = sum(_order(one.scan) <= _order(scan) for one in history)
    if number == 0 and history[0].before.time > scan.time:
        return None
    return number


def _order(scan: Scan) -> tuple[float, int]:
    return scan.time, scan.place


def up_to_date(step: Step[S, A], history: tuple[Taken[S, A], ...], number: int) -> tuple[Taken[S, A], ...]:
    """The history in which no state up to that before the scan of this number is outdated."""
    redone: list[Taken[S, A]] = []
    for one in history[: number + 1]:
        if one.outdated:
            last = redone[-1]
            one = one._replace(before=step(last.before, last.scan, last.origins)[0], outdated=False)
        redone.append(one)
    return (*redone, *history[number + 1 :])


def inserted(history: tuple[Taken[S, A], ...], number: int, scan: Scan) -> tuple[Taken[S, A], ...]:
    """The history with a late scan at its position, where no state up to that is outdated; those after it then are."""
    taken: Taken[S, A] = Taken(history[number].before, scan)
    return (*history[:number], taken, *(one._replace(outdated=True) for one in history[number:]))


def replayed(
    step: Step[S, A], history: tuple[Taken[S, A], ...], number: int, scan: Scan, origins: Indices | None = None
) -> Replayed[S, A]:
    """Take a late scan in at its position in the history, and the later ones again."""
    before = history[number].before
    state, late = step(before, scan, origins)
    redone, latest = [Taken(before, scan, origins, late)], late
    for one in history[number:]:
        before = state
        state, latest = step(before, one.scan, one.origins)
        redone.append(Taken(before, one.scan, one.origins, latest))
    return Replayed(state, late, latest, (*history[:number], *redone))

"""Scans that are older than what a tracker has already taken in: out-of-sequence measurements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Literal, NamedTuple, Protocol, TypeVar

from trackbench.types import Indices, Scan

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


class Taken(NamedTuple, Generic[S]):
    """A scan that was taken in."""

    before: S
    """The state before it."""
    scan: Scan
    origins: Indices | None = None
    """Of its detections, for the tracker that knows them."""
    outdated: bool = False
    """Whether a late scan has been taken in since, of a time before it, that ``before`` does not hold."""


class Replayed(NamedTuple, Generic[S, A]):
    """What going back to a late scan's time and taking all later scans in again gave."""

    state: S
    late: A
    """What the tracker said after the late scan."""
    latest: A
    """What it said after the latest scan."""
    history: tuple[Taken[S], ...]


def kept(step: Step[S, A], history: tuple[Taken[S], ...], taken: Taken[S], lag: float) -> tuple[Taken[S], ...]:
    """The history with one more scan, and without those that are older than it by more than ``lag`` seconds."""
    first = sum(one.scan.time < taken.scan.time - lag for one in history)
    if first == len(history):
        return (taken,)
    return (*up_to_date(step, history, first)[first:], taken)


def position(history: tuple[Taken[S], ...], scan: Scan) -> int | None:
    """Where in the history a scan belongs that was taken earlier than its last one.

    None where it was not, or where the history does not reach back so far. Scans of one time are in the order in which
    they are delivered when nothing is late.
    """
    number = sum((one.scan.time, one.scan.place) <= (scan.time, scan.place) for one in history)
    if number == len(history) or (number == 0 and history[0].before.time > scan.time):
        return None
    return number


def up_to_date(step: Step[S, A], history: tuple[Taken[S], ...], number: int) -> tuple[Taken[S], ...]:
    """The history in which no state up to that before the scan of this number is outdated."""
    redone: list[Taken[S]] = []
    for one in history[: number + 1]:
        if one.outdated:
            last = redone[-1]
            one = one._replace(before=step(last.before, last.scan, last.origins)[0], outdated=False)
        redone.append(one)
    return (*redone, *history[number + 1 :])


def inserted(history: tuple[Taken[S], ...], number: int, scan: Scan) -> tuple[Taken[S], ...]:
    """The history with a late scan at its position, where no state up to that is outdated; those after it then are."""
    taken = Taken(history[number].before, scan)
    return (*history[:number], taken, *(one._replace(outdated=True) for one in history[number:]))


def replayed(
    step: Step[S, A], history: tuple[Taken[S], ...], number: int, scan: Scan, origins: Indices | None = None
) -> Replayed[S, A]:
    """Take a late scan in at its position in the history, and the later ones again."""
    state = history[number].before
    redone = [Taken(state, scan, origins)]
    state, late = step(state, scan, origins)
    latest = late
    for one in history[number:]:
        redone.append(Taken(state, one.scan, one.origins))
        state, latest = step(state, one.scan, one.origins)
    return Replayed(state, late, latest, (*history[:number], *redone))

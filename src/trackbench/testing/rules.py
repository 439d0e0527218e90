"""What the check-ups of trackers share: synthetic noise, batches, and whether a tracker is of one object or several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Literal, TypeVar

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Estimate, Scan, Tracks
from trackbench.trackers.answers import unpack

Identities = Literal["known", "hidden"]
#: So many scans show it.
TRIED = 20
#: The rule of those that are given their state.
STATE_KEPT = "leaves the state that it is given as it is"
OF_OTHER_KIND: Mapping[Identities, str] = {
    "known": 'it follows several objects: say identities="hidden"',
    "hidden": 'it follows one object: leave identities="hidden" out',
}


def require_identities(identities: str) -> None:
    """Refuse what is neither of the two."""
    if identities not in OF_OTHER_KIND:
        raise InputError(f"{identities!r} is not known; {nearest_choices(identities, OF_OTHER_KIND)}", key="identities")


def gives_reports(reports: Callable[[], Iterable[bool]]) -> bool:
    """Whether a tracker bears some scans and says something, given whether it does after each of them."""
    try:
        return any(list(islice(reports(), TRIED)))
    except (Exception, SystemExit):
        return False


Answer = TypeVar("Answer", Estimate | None, Tracks)

NOISE = {
    "radar": np.diag([0.3, np.deg2rad(0.5), 0.1]) ** 2,
    "lidar": np.diag([0.15, 0.15]) ** 2,
}
#: A tracker of a target in plain sight that is further off than this has not followed it, m and m/s.
LOST = 5.0


class TrackerCheckError(AssertionError):
    """A tracker does not keep the contract; the text lists every broken rule."""


def batched_scan(runs: Sequence[Scan]) -> Scan:
    """The scans of several runs at one instant with a last axis of runs, padded to as many detections."""
    most = np.max([scan.valid.shape for scan in runs], axis=0).astype(int)
    measurement = np.full((len(runs[0].measurement), *most, len(runs)), np.nan)
    valid = np.zeros((*most, len(runs)), dtype=bool)
    for run, scan in enumerate(runs):
        there: tuple[slice | int, ...] = (*map(slice, scan.valid.shape), run)
        measurement[:, *there], valid[there] = scan.measurement, scan.valid
    for shared in (measurement, valid):
        shared.setflags(write=False)
    return runs[0]._replace(measurement=measurement, valid=valid)


def checked_answers(
    tracker: Any, scans: Iterable[Scan], check: Callable[[Any, Scan], Answer], what: str = "estimate"
) -> Iterator[Answer]:
    """Yield what a fresh tracker answers to each scan.

    Args:
        tracker: the tracker.
        scans: of a batch, where the tracker takes one.
        check: makes an answer one of the right form, or raises a TrackerFault.
        what: the answer, in messages.
    """
    state: Any = None
    for scan in scans:
        state, answer = unpack(tracker.step(state, scan), what)
        yield check(answer, scan)


def require_state_kept(
    tracker: Any, scans: Sequence[Scan], check: Callable[[Any, Scan], Answer], what: str, other: str
) -> None:
    """Refuse a fresh tracker that gives another answer to the same state and scan of one run the second time.

    ``check`` and ``what`` are those of ``checked_answers``; ``other`` is another answer, in the message.
    """
    state: Any = None
    for scan in [batched_scan([scan]) for scan in scans] if getattr(tracker, "batched", False) else scans:
        after, first = unpack(tracker.step(state, scan), what)
        again = unpack(tracker.step(state, scan), what)[1]
        before, repeated = check(first, scan), check(again, scan)
        same = before is repeated is None or (
            before is not None and repeated is not None and np.array_equal(before.mean, repeated.mean, equal_nan=True)
        )
        if not same:
            raise TrackerCheckError(
                f"at {scan.time:g} s the same state and scan give {other} the second time: "
                "the state was changed in place, or the tracker remembers something beside it"
            )
        state = after

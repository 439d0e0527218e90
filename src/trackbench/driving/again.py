"""Trackers that are asked again: what one says of a member must not depend on the other members.

A batched tracker may read, by intent or by a wrong axis, what only the other members of its batch were given. So a
fresh one, in a process of its own, is given the same scans with half of the members replaced by those of other scenes
and all of them permuted. Instances of any other may share a value; so fresh ones are given two runs in another order.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Scan, Tracks
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.start import ending
from trackbench.trackers.answers import NO_TRACK

#: Largest difference between the two estimates of a member, relative to the largest entry: rounding that depends on the
#: column is 1e-16, and a recursion makes little more of it.
SAME = 1e-9
#: Largest number of members that are compared: of so many all answers are kept.
COMPARED = 250
#: By whether the tracker takes batches: how it is asked again, and the likely cause of another answer.
HOW = {
    True: "asked again with half of the batch replaced by other scenes and all of it permuted",
    False: "asked again in a fresh process, with two runs in another order",
}
CAUSES = {
    True: "likely an operation over the last axis, which is the batch",
    False: "likely a value that instances share (an attribute of the class, a variable of the module)",
}
RANDOM = "a tracker that draws random numbers says random = True"


class Disagreement(NamedTuple):
    """Difference between two drives of a tracker, and the scan at which it shows."""

    fault: TrackFault
    scan: Scan


class AskedAgain:
    """A tracker whose answers are kept, and compared with those of a second drive in which its members have others
    beside them.

    Args:
        tracker: the tracker of the first drive.
        start: gives a fresh tracker for the batch of the second drive.
        order: ``(width,)`` the member in each column of the second drive: of the first drive, or, from ``members`` on,
            of the others.
        members: number of members of the first drive.
        others: scans of other scenes, at the same times by the same sensors.
    """

    def __init__(
        self, tracker: Any, start: Callable[[], Any], order: Indices, members: int, others: Sequence[Scan]
    ) -> None:
        self._tracker, self._start, self._order, self._count, self._others = tracker, start, order, members, others
        self._columns = np.flatnonzero(order < members)[:COMPARED]
        self._members = order[self._columns]
        self._kept: list[tuple[Scan, dict[str, Array]]] = []

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        """Return the tracker's state and answer, which is kept."""
        state, answer = self._tracker.step(state, scan)
        self._kept.append((scan, _parts(answer, self._members)))
        return state, answer

    def disagreement(self) -> Disagreement | None:
        """Return where the second drive first differs from the first, or where it fails."""
        others = defaultdict[tuple[float, str], list[Scan]](list)
        for other in reversed(self._others):
            others[other.time, other.sensor].append(other)
        batched, state, before = self._tracker.batched, None, None
        try:
            with ending(self._start()) as tracker:
                for scan, kept in self._kept:
                    beside = others[scan.time, scan.sensor].pop() if scan.valid.any() else None
                    state, answer = tracker.step(state, self._scan(scan, beside))
                    parts = _parts(answer, self._columns)
                    difference = _difference(kept, parts) or _renamed(before, (kept, parts))
                    before = kept, parts
                    if difference is not None:
                        member, what = difference
                        text = f"{HOW[batched]}, it gives another estimate: {what}; {CAUSES[batched]}; {RANDOM}"
                        return Disagreement(TrackFault(text, "answer", member=int(self._members[member])), scan)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            fault = fault_of(error)
            if fault.member is not None:
                member = int(self._order[fault.member])
                fault.member = member if member < self._count else None
            fault.cause = f"{HOW[batched]}, it fails: {fault.cause}"
            return Disagreement(fault, scan)
        return None

    def _scan(self, scan: Scan, other: Scan | None) -> Scan:
        """Return the scan of the second drive; without measurements where there are none of the others."""
        if other is None:
            return scan_of_columns(scan, self._order % self._count)
        if scan.valid.ndim == 2:
            most = max(len(scan.valid), len(other.valid))
            scan, other = _padded(scan, most), _padded(other, most)
        measurement = np.concatenate([scan.measurement, other.measurement], axis=-1)
        valid = np.concatenate([scan.valid, other.valid], axis=-1)
        return scan_of_columns(scan._replace(measurement=measurement, valid=valid), self._order)


def scan_of_columns(scan: Scan, order: Indices) -> Scan:
    """Return the scan with these members, without columns of detections that none of them has."""
    measurement, valid = scan.measurement[..., order], scan.valid[..., order]
    if valid.ndim == 2:
        most = int(valid.sum(axis=0).max(initial=0))
        measurement, valid = measurement[:, :most], valid[:most]
    measurement, valid = np.ascontiguousarray(measurement), np.ascontiguousarray(valid)
    for shared in (measurement, valid):
        shared.setflags(write=False)
    return scan._replace(measurement=measurement, valid=valid)


def _padded(scan: Scan, most: int) -> Scan:
    """Return a scan with as many columns of detections."""
    missing = most - len(scan.valid)
    measurement = np.pad(scan.measurement, ((0, 0), (0, missing), (0, 0)), constant_values=np.nan)
    return scan._replace(measurement=measurement, valid=np.pad(scan.valid, ((0, missing), (0, 0))))


def _parts(answer: Any, columns: Indices) -> dict[str, Array]:
    """Return the arrays ``(..., members)`` of an answer that are compared; tracks in the order of their ids, which a
    shared counter may number as it likes."""
    if answer is None:
        return {"mean": np.full((4, len(columns)), np.nan), "covariance": np.full((4, 4, len(columns)), np.nan)}
    if not isinstance(answer, Tracks):
        return {"mean": answer.mean[..., columns], "covariance": answer.covariance[..., columns]}
    ids = np.where(answer.ids == NO_TRACK, np.nan, answer.ids)[:, columns]
    order = np.argsort(ids, axis=0, kind="stable")[: int(np.isfinite(ids).sum(axis=0).max(initial=0))]
    named = zip(Tracks._fields, (ids, *answer[1:]), strict=True)
    parts = {name: part[..., columns] if name != "ids" else ids for name, part in named if part is not None}
    parts = {name: part[..., order, np.arange(len(columns))] for name, part in parts.items()}
    return {name: np.where(np.isnan(parts["ids"]), np.nan, part) for name, part in parts.items()}


def _difference(kept: dict[str, Array], again: dict[str, Array]) -> tuple[int, str] | None:
    """Return the member whose estimate differs most, and how; None where none does."""
    for what in kept:
        if what == "ids" or what not in again:
            continue
        value, other = kept[what], again[what]
        if value.shape != other.shape:
            # Of tracks, one drive has fewer.
            most = max(value.shape[-2], other.shape[-2])
            value, other = (_with_tracks(part, most) for part in (value, other))
        axes = tuple(range(value.ndim - 1))
        is_same = (value == other) | (np.isnan(value) & np.isnan(other))
        if is_same.all():
            continue
        with np.errstate(invalid="ignore"):
            apart = np.where(is_same, 0.0, np.nan_to_num(np.abs(value - other), nan=np.inf)).max(axis=axes)
        largest = np.maximum(*(np.nan_to_num(np.abs(part)).max(axis=axes) for part in (value, other)))
        gap = apart / np.where(largest > 0.0, largest, 1.0)
        member = int(np.argmax(gap))
        if gap[member] == np.inf:
            return member, f"one has a {what} where the other has none"
        if gap[member] > SAME:
            size = f"{apart[member]:.3g}{' m or m/s' if what == 'mean' else ''}, {gap[member]:.1e} of its largest entry"
            return member, f"the {what} differs by up to {size}"
    return None


def _with_tracks(part: Array, most: int) -> Array:
    missing = [(0, 0)] * (part.ndim - 2) + [(0, most - part.shape[-2]), (0, 0)]
    return np.pad(part, missing, constant_values=np.nan)


def _renamed(before: Any, now: tuple[dict[str, Array], dict[str, Array]]) -> tuple[int, str] | None:
    """Return the member of which a track goes on from the scan before in one drive and not in the other."""
    if before is None or "ids" not in now[0] or "ids" not in before[0]:
        return None
    goes_on, other_goes_on = (then["ids"][:, None] == those["ids"] for then, those in zip(now, before, strict=True))
    renamed = (goes_on != other_goes_on).any(axis=(0, 1))
    return (int(np.argmax(renamed)), "a track goes on under another id") if renamed.any() else None

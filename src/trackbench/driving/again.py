"""Trackers that are asked again: what one says of a member must not depend on the other members.

A batched tracker may read, by a wrong axis, what only the other members of its batch were given. So a fresh one, in a
process of its own, is given the scans of half of the members, permuted. Instances of any other may share a value; so
fresh ones are given two runs in another order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from trackbench.base.types import Array, Indices, Scan, Tracks
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.start import ending
from trackbench.trackers.answers import NO_TRACK

#: Largest difference between the two estimates of a member, relative to the largest entry, by whether the tracker takes
#: batches: rounding that depends on the column is 1e-16, and a recursion makes little more of it.
SAME = {True: 1e-9, False: 0.0}
#: Largest number of members that are compared: of so many all answers are kept.
COMPARED = 250
#: By whether the tracker takes batches: how it is asked again, and the likely cause of another answer.
HOW = {
    True: "asked again with half of the batch, permuted",
    False: "asked again in a fresh process, with two runs in another order",
}
CAUSES = {
    True: "likely an operation over the last axis, which is the batch",
    False: "likely a value that instances share (an attribute of the class, a variable of the module)",
}
RANDOM = "a tracker that draws random numbers says random = True"


class AskedAgain:
    """A tracker whose answers are compared with those of a second drive, in which its members have others beside them.

    Args:
        tracker: the tracker of the first drive.
        start: gives a fresh tracker for the batch of the second drive.
        order: ``(width,)`` the member of the first drive in each column of the second.
    """

    def __init__(self, tracker: Any, start: Callable[[], Any], order: Indices) -> None:
        self._tracker, self._start, self._order = tracker, start, order
        self._columns = np.arange(min(len(order), COMPARED))
        self._members = order[self._columns]
        self._kept: list[tuple[Scan, dict[str, Array]]] = []

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        """Return the tracker's state and answer, which is kept."""
        state, answer = self._tracker.step(state, scan)
        self._kept.append((scan, _parts(answer, self._members)))
        return state, answer

    def disagreement(self) -> tuple[TrackFault, Scan] | None:
        """Return how the second drive first differs from the first, or how it fails, and at which scan."""
        how, same, state = HOW[self._tracker.batched], SAME[self._tracker.batched], None
        before: dict[str, Array] = {}
        parts_before: dict[str, Array] = {}
        try:
            with ending(self._start()) as tracker:
                for scan, kept in self._kept:
                    state, answer = tracker.step(state, self._scan(scan))
                    parts = _parts(answer, self._columns)
                    difference = _difference(kept, parts, same) or _renamed(before, kept, parts_before, parts)
                    if difference is not None:
                        member, what = difference
                        text = f"{how}, it gives another estimate: {what}; {CAUSES[self._tracker.batched]}; {RANDOM}"
                        return TrackFault(text, "answer", member=int(self._members[member])), scan
                    before, parts_before = kept, parts
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            fault = fault_of(error)
            fault.member = None if fault.member is None else int(self._order[fault.member])
            fault.cause = f"{how}, it fails: {fault.cause}"
            return fault, scan
        return None

    def _scan(self, scan: Scan) -> Scan:
        """Return the scan of the second drive, without columns of detections that none of its members has."""
        measurement, valid = scan.measurement[..., self._order], scan.valid[..., self._order]
        if valid.ndim == 2:
            most = int(valid.sum(axis=0).max(initial=0))
            measurement, valid = measurement[:, :most], valid[:most]
        measurement, valid = np.ascontiguousarray(measurement), np.ascontiguousarray(valid)
        for shared in (measurement, valid):
            shared.setflags(write=False)
        return scan._replace(measurement=measurement, valid=valid)


def _padded(part: Array, most: int, fill: float = np.nan) -> Array:
    missing = [(0, 0)] * (part.ndim - 2) + [(0, most - part.shape[-2]), (0, 0)]
    return np.pad(part, missing, constant_values=fill)


def _parts(answer: Any, columns: Indices) -> dict[str, Array]:
    """Return the arrays ``(..., members)`` of an answer that are compared; tracks in the order of their ids, which a
    shared counter may number as it likes."""
    if answer is None:
        return {"mean": np.full((4, len(columns)), np.nan), "covariance": np.full((4, 4, len(columns)), np.nan)}
    if not isinstance(answer, Tracks):
        return {"mean": answer.mean[..., columns], "covariance": answer.covariance[..., columns]}
    parts = {name: part[..., columns] for name, part in zip(Tracks._fields, answer, strict=True) if part is not None}
    ids = parts["ids"] = np.where(parts["ids"] == NO_TRACK, np.nan, parts["ids"])
    order = np.argsort(ids, axis=0, kind="stable")[: int(np.isfinite(ids).sum(axis=0).max(initial=0))]
    parts = {name: part[..., order, np.arange(len(columns))] for name, part in parts.items()}
    return {name: np.where(np.isnan(parts["ids"]), np.nan, part) for name, part in parts.items()}


def _difference(kept: Mapping[str, Array], again: Mapping[str, Array], same: float) -> tuple[int, str] | None:
    """Return the member whose estimate differs most, and how; None where none differs by more than a share ``same``."""
    for what in kept:
        if what == "ids" or what not in again:
            continue
        most = max(kept[what].shape[-2], again[what].shape[-2])
        value, other = _padded(kept[what], most), _padded(again[what], most)
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
        if gap[member] > same:
            size = f"{apart[member]:.3g}{' m or m/s' if what == 'mean' else ''}, {gap[member]:.1e} of its largest entry"
            return member, f"the {what} differs by up to {size}"
    return None


def _renamed(*parts: Mapping[str, Array]) -> tuple[int, str] | None:
    """Return the member of which a track goes on in one drive and not in the other: parts before and now, of either."""
    if not all("ids" in each for each in parts):
        return None
    before, now, other_before, other_now = (each["ids"] for each in parts)
    renamed = ((before[:, None] == now) != (other_before[:, None] == other_now)).any(axis=(0, 1))
    return (int(np.argmax(renamed)), "a track goes on under another id") if renamed.any() else None

"""Check that a tracker's estimates of one member of the batch do not depend on the other members.

A batched tracker may read other members' data by a wrong axis. So a fresh one, in a process of its own, gets the scans
of half of the members, permuted. Instances of an unbatched tracker may share a value; so fresh ones get two runs in
another order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from trackbench.base.types import Array, Indices, Scan, Tracks
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.start import ending
from trackbench.trackers.answers import NO_TRACK

#: Largest difference between the two estimates of a member, relative to the largest entry, by whether the tracker is
#: batched. Rounding depends on the column and is 1e-16; a recursion amplifies it little.
SAME = {True: 1e-9, False: 0.0}
#: Largest number of members compared, since all their answers are stored.
COMPARED = 250
#: How the second drive differs, and the likely cause of a difference, by whether the tracker is batched.
HOW = {
    True: "asked again with half of the batch, permuted",
    False: "asked again in a fresh process, with two runs in another order",
}
CAUSES = {
    True: "likely an operation over the last axis, which is the batch",
    False: "likely a value that instances share (an attribute of the class, a variable of the module)",
}
RANDOM = "a tracker that draws random numbers must set random = True"


class CrossCheckedTracker:
    """Tracker whose answers are compared with a second drive, in which each member is batched with other members.

    Args:
        tracker: the tracker of the first drive.
        start: returns a fresh tracker for the batch of the second drive.
        order: ``(width,)`` index, in the batch of the first drive, of the member in each column of the second drive.
    """

    def __init__(self, tracker: Any, start: Callable[[], Any], order: Indices) -> None:
        self._tracker, self._start, self._order = tracker, start, order
        self._columns = np.arange(min(len(order), COMPARED))
        self._members = order[self._columns]
        self._kept: list[tuple[Scan, dict[str, Array]]] = []

    def step(self, state: Any, scan: Scan) -> tuple[Any, Any]:
        """Step the tracker of the first drive; return its state and answer, and store the answer for the comparison."""
        state, answer = self._tracker.step(state, scan)
        self._kept.append((scan, _parts(answer, self._members)))
        return state, answer

    def disagreement(self) -> tuple[TrackFault, Scan] | None:
        """Return the first difference between the drives, or the second drive's failure, with the scan; else None."""
        how, same, state = HOW[self._tracker.batched], SAME[self._tracker.batched], None
        last_stored: dict[str, Array] = {}
        last_parts: dict[str, Array] = {}
        try:
            with ending(self._start()) as tracker:
                for scan, stored in self._kept:
                    state, answer = tracker.step(state, self._scan(scan))
                    parts = _parts(answer, self._columns)
                    difference = _difference(stored, parts, same) or _renamed(last_stored, stored, last_parts, parts)
                    if difference is not None:
                        member, what = difference
                        text = f"{how}, it gives another estimate: {what}; {CAUSES[self._tracker.batched]}; {RANDOM}"
                        return TrackFault(text, "answer", member=int(self._members[member])), scan
                    last_stored, last_parts = stored, parts
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            fault = fault_of(error)
            fault.member = None if fault.member is None else int(self._order[fault.member])
            fault.cause = f"{how}, it fails: {fault.cause}"
            return fault, scan
        return None

    def _scan(self, scan: Scan) -> Scan:
        measurement, valid = scan.measurement[..., self._order], scan.valid[..., self._order]
        if valid.ndim == 2:
            column_count = int(valid.sum(axis=0).max(initial=0))
            measurement, valid = measurement[:, :column_count], valid[:column_count]
        measurement, valid = np.ascontiguousarray(measurement), np.ascontiguousarray(valid)
        for shared in (measurement, valid):
            shared.setflags(write=False)
        return scan._replace(measurement=measurement, valid=valid)


def _padded(values: Array, rows: int, fill: float = np.nan) -> Array:
    padding = [(0, 0)] * (values.ndim - 2) + [(0, rows - values.shape[-2]), (0, 0)]
    return np.pad(values, padding, constant_values=fill)


def _parts(answer: Any, columns: Indices) -> dict[str, Array]:
    """Return the arrays ``(..., members)`` to compare in an answer; tracks are sorted by id, as ids may differ."""
    if answer is None:
        return {"mean": np.full((4, len(columns)), np.nan), "covariance": np.full((4, 4, len(columns)), np.nan)}
    if not isinstance(answer, Tracks):
        return {"mean": answer.mean[..., columns], "covariance": answer.covariance[..., columns]}
    parts = {name: part[..., columns] for name, part in zip(Tracks._fields, answer, strict=True) if part is not None}
    ids = parts["ids"] = np.where(parts["ids"] == NO_TRACK, np.nan, parts["ids"])
    order = np.argsort(ids, axis=0, kind="stable")[: int(np.isfinite(ids).sum(axis=0).max(initial=0))]
    parts = {name: part[..., order, np.arange(len(columns))] for name, part in parts.items()}
    return {name: np.where(np.isnan(parts["ids"]), np.nan, part) for name, part in parts.items()}


def _difference(stored: Mapping[str, Array], parts: Mapping[str, Array], tolerance: float) -> tuple[int, str] | None:
    """Return the member whose estimate differs most, and a description; None if no difference exceeds ``tolerance``."""
    for name in stored:
        if name == "ids" or name not in parts:
            continue
        rows = max(stored[name].shape[-2], parts[name].shape[-2])
        value, other = _padded(stored[name], rows), _padded(parts[name], rows)
        axes = tuple(range(value.ndim - 1))
        is_same = (value == other) | (np.isnan(value) & np.isnan(other))
        if is_same.all():
            continue
        with np.errstate(invalid="ignore"):
            gap = np.where(is_same, 0.0, np.nan_to_num(np.abs(value - other), nan=np.inf)).max(axis=axes)
        largest = np.maximum(*(np.nan_to_num(np.abs(part)).max(axis=axes) for part in (value, other)))
        ratio = gap / np.where(largest > 0.0, largest, 1.0)
        member = int(np.argmax(ratio))
        if ratio[member] == np.inf:
            return member, f"one has a {name} where the other has none"
        if ratio[member] > tolerance:
            size = f"{gap[member]:.3g}{' m or m/s' if name == 'mean' else ''}, {ratio[member]:.1e} of its largest entry"
            return member, f"the {name} differs by up to {size}"
    return None


def _renamed(*parts: Mapping[str, Array]) -> tuple[int, str] | None:
    """Return a member with a track that keeps its id in one drive only; None if there is none."""
    if not all("ids" in drive_parts for drive_parts in parts):
        return None
    before, now, other_before, other_now = (drive_parts["ids"] for drive_parts in parts)
    is_renamed = ((before[:, None] == now) != (other_before[:, None] == other_now)).any(axis=(0, 1))
    return (int(np.argmax(is_renamed)), "a track goes on under another id") if is_renamed.any() else None

"""Trackers that are asked again: what one says of a member must not depend on the other members.

A batched tracker may read, by intent or by a wrong axis, what only the other members of its batch were given. So a
fresh one, in a process of its own, is given the same scans with half of the members replaced by those of other scenes
and all of them permuted. The batch has the same width, and nothing tells the tracker which of the two it is.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Any, NamedTuple, Protocol

import numpy as np

from trackbench.base.types import Array, Estimate, Indices, Mask, Scan, Tracks
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Stepper
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import NO_TRACK

#: Largest difference between the two estimates of a member of a batch, relative to the largest entry: rounding that
#: depends on the column is 1e-16, and a recursion makes little more of it.
SAME = 1e-9
#: Largest number of members that are compared: of so many all answers are kept.
COMPARED = 250
BATCHED = "asked again with half of the batch replaced by other scenes and all of it permuted"
UNBATCHED = "asked again in a fresh process, with two runs in another order"
CAUSES = {
    BATCHED: "likely an operation over the last axis, which is the batch",
    UNBATCHED: "likely a value that instances share (an attribute of the class, a variable of the module)",
}
RANDOM = "a tracker that draws random numbers says random = True"


class StepTaken(NamedTuple):
    """What a tracker was given, and what it answered."""

    scan: Scan
    answer: Any
    """Estimate ``(4, n)`` or tracks of the n members that are compared; None if there was none."""


class Disagreement(NamedTuple):
    """Difference between two drives of a tracker, and the scan at which it shows."""

    fault: TrackFault
    scan: Scan


class SecondDrive(Protocol):
    """Drives a fresh tracker, and holds its answers against those of the first one."""

    members: Indices
    """``(n,)`` columns of the first drive that are compared."""

    def disagreement(self, steps: Sequence[StepTaken]) -> Disagreement | None:
        """Return where both drives first differ."""


class AskedAgain(Stepper):
    """A tracker whose answers are kept until it is asked again.

    Args:
        stepper: the tracker.
        second: the second drive.
    """

    def __init__(self, stepper: Stepper, second: SecondDrive) -> None:
        self._stepper, self._second = stepper, second
        self._steps: list[StepTaken] = []
        self.traits = stepper.traits

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """Return the tracker's answer, and keep it."""
        answer = self._stepper.step(scan, origins)
        self._steps.append(StepTaken(scan, answer_of_columns(answer, self._second.members)))
        return answer

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computed the steps so far."""
        return self._stepper.engine_used

    def close(self) -> None:
        """End the tracker."""
        self._stepper.close()

    def disagreement(self) -> Disagreement | None:
        """Ask again, once all scans were given; return where the answers first differ."""
        steps, self._steps = self._steps, []
        return self._second.disagreement(steps) if steps else None


class OtherCompany:
    """The second drive of a tracker in whose batch others stand beside the members that are compared.

    Args:
        start: gives a fresh tracker for the batch.
        order: ``(width,)`` the member in each column: of the first drive, or, from ``members`` on, of the others.
        members: number of members of the first drive.
        others: scans of other scenes, at the same times by the same sensors.
        batched: whether it takes its batch at once, so that members may differ by rounding; any other gives the same
            bits.
    """

    def __init__(
        self, start: Callable[[], Stepper], order: Indices, members: int, others: Sequence[Scan], batched: bool
    ) -> None:
        self._start, self._order, self._count, self._others = start, order, members, others
        self._how, self._largest = (BATCHED, SAME) if batched else (UNBATCHED, 0.0)
        self._columns = np.flatnonzero(order < members)[:COMPARED]
        self.members = order[self._columns]
        self._ids: tuple[Indices, Indices] | None = None

    def disagreement(self, steps: Sequence[StepTaken]) -> Disagreement | None:
        """Return where the answers to members first differ, or where the second drive fails."""
        others = defaultdict[tuple[float, str], list[Scan]](list)
        for other in reversed(self._others):
            others[other.time, other.sensor].append(other)
        scan = steps[0].scan
        try:
            with closing(self._start()) as stepper:
                for scan, answer in steps:
                    beside = others[scan.time, scan.sensor].pop() if scan.valid.any() else None
                    again = answer_of_columns(stepper.step(self._scan(scan, beside)), self._columns)
                    fault = self._compared(answer, again)
                    if fault is not None:
                        return Disagreement(fault, scan)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return Disagreement(self._failure(fault_of(error)), scan)
        return None

    def _scan(self, scan: Scan, other: Scan | None) -> Scan:
        """The scan of the second drive; without measurements where there are none of the others."""
        if other is None:
            return scan_of_columns(scan, self._order % self._count)
        if scan.valid.ndim == 2:
            most = max(len(scan.valid), len(other.valid))
            scan, other = _padded(scan, most), _padded(other, most)
        measurement = np.concatenate([scan.measurement, other.measurement], axis=-1)
        valid = np.concatenate([scan.valid, other.valid], axis=-1)
        return scan_of_columns(scan._replace(measurement=measurement, valid=valid), self._order)

    def _failure(self, fault: TrackFault) -> TrackFault:
        """A failure of the second drive alone, of the member of the first where that has it."""
        member = None if fault.member is None else int(self._order[fault.member])
        if member is not None and member >= self._count:
            member = None
        return TrackFault(f"{self._how}, it fails: {fault.cause}", fault.kind, fault.place, member)

    def _compared(self, answer: Any, again: Any) -> TrackFault | None:
        if isinstance(answer, Tracks):
            answer, again = _sorted_by_id(answer), _sorted_by_id(again)
            renamed = self._renamed(answer.ids, again.ids)
            if renamed.any():
                return self._fault(int(np.argmax(renamed)), "a track goes on under another id")
        for what, value, other in _pairs(answer, again, len(self.members)):
            gap = _gap(value, other)
            if (gap > self._largest).any():
                member = int(np.argmax(gap))
                return self._fault(member, _difference(what, value[..., member], other[..., member], gap[member]))
        return None

    def _renamed(self, ids: Indices, others: Indices) -> Mask:
        """``(members,)`` where a track goes on from the scan before in one drive and not in the other."""
        before, self._ids = self._ids, (ids, others)
        if before is None or ids.shape != others.shape or before[0].shape != before[1].shape:
            return np.zeros(len(self.members), dtype=bool)
        goes_on, other_goes_on = (now[:, None] == then for now, then in zip((ids, others), before, strict=True))
        renamed: Mask = np.any(goes_on != other_goes_on, axis=(0, 1))
        return renamed

    def _fault(self, member: int, difference: str) -> TrackFault:
        text = f"{self._how}, it gives another estimate: {difference}; {CAUSES[self._how]}; {RANDOM}"
        return TrackFault(text, "answer", member=int(self.members[member]))


def answer_of_columns(answer: Any, columns: Indices) -> Any:
    """Return the estimate, or the tracks, of the members in some columns."""
    if answer is None:
        return None
    if isinstance(answer, Tracks):
        return Tracks(*(None if part is None else part[..., columns] for part in answer))  # type: ignore[arg-type]
    return Estimate(answer.mean[..., columns], answer.covariance[..., columns])


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
    """A scan with as many columns of detections."""
    missing = most - len(scan.valid)
    measurement = np.pad(scan.measurement, ((0, 0), (0, missing), (0, 0)), constant_values=np.nan)
    return scan._replace(measurement=measurement, valid=np.pad(scan.valid, ((0, missing), (0, 0))))


def _sorted_by_id(tracks: Tracks) -> Tracks:
    """Tracks in the order of their ids, which a shared counter may number as it likes, with as little padding as can
    be."""
    ids = tracks.ids
    order = np.argsort(np.where(ids == NO_TRACK, np.iinfo(ids.dtype).max, ids), axis=0, kind="stable")
    order = order[: int((ids != NO_TRACK).sum(axis=0).max(initial=0))]
    parts = (None if part is None else part[..., order, np.arange(ids.shape[1])] for part in tracks)
    return Tracks(*parts)  # type: ignore[arg-type]


def _pairs(answer: Any, again: Any, members: int) -> Iterator[tuple[str, Array, Array]]:
    """The parts of both answers, arrays ``(..., members)``."""
    if isinstance(answer, Tracks):
        most = max(len(answer.ids), len(again.ids))
        for name in ("mean", "covariance", "existence", "used"):
            value, other = getattr(answer, name), getattr(again, name)
            if value is not None and other is not None:
                yield name, _with_tracks(value, most), _with_tracks(other, most)
        return
    for name, shape in (("mean", (4, members)), ("covariance", (4, 4, members))):
        value, other = (np.full(shape, np.nan) if of is None else getattr(of, name) for of in (answer, again))
        yield name, value, other


def _with_tracks(value: Array, most: int) -> Array:
    """An array ``(..., K, members)``, padded by NaN to so many tracks."""
    missing = np.full((*value.shape[:-2], most - value.shape[-2], value.shape[-1]), np.nan)
    return np.concatenate([value, missing], axis=-2)


def _gap(value: Array, again: Array) -> Array:
    """``(members,)`` largest difference of the entries of two arrays ``(..., members)``, relative to the largest entry.

    Infinite where one of them has a number and the other none.
    """
    axes = tuple(range(value.ndim - 1))
    same = (value == again) | (np.isnan(value) & np.isnan(again))
    if same.all():
        return np.zeros(value.shape[-1])
    with np.errstate(invalid="ignore"):
        apart = np.where(same, 0.0, np.nan_to_num(np.abs(value - again), nan=np.inf)).max(axis=axes, initial=0.0)
    largest = np.maximum(np.nan_to_num(np.abs(value)), np.nan_to_num(np.abs(again))).max(axis=axes, initial=0.0)
    gap: Array = np.divide(apart, largest, out=apart, where=largest > 0.0)
    return gap


def _difference(what: str, value: Array, again: Array, gap: float) -> str:
    """How the estimates of one member differ."""
    if not np.isfinite(gap):
        return f"one has a {what} where the other has none"
    apart = float(np.nanmax(np.abs(value - again)))
    unit = " m or m/s" if what == "mean" else ""
    return f"the {what} differs by up to {apart:.3g}{unit}, {gap:.1e} of its largest entry"

"""A second drive of a tracker, whose members have other company: what they are told must not depend on it.

A batched tracker may read, by intent or by a wrong axis, what only the other members of its batch were given. So a
fresh one, in a process of its own, is driven through the same scans with half of the members replaced by those of other
scenes and all of them permuted. The batch has the same width, and nothing tells the tracker which of the two it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask, Scan, Tracks
from trackbench.driving.drive import DriveStep
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.steppers import Stepper
from trackbench.trackers.answers import NO_TRACK

#: Largest difference between the two estimates of a member of a batch, relative to the largest entry: rounding that
#: depends on the column is 1e-16, and a recursion makes little more of it.
SAME = 1e-9
#: Number of scans that a process which serves several trackers is given before those that are compared.
BEFORE = 20
BATCHED = "asked again with half of the batch replaced by other scenes and all of it permuted"
UNBATCHED = "asked again in a fresh process, with two runs in another order"
CAUSES = {
    BATCHED: "likely an operation over the last axis, which is the batch",
    UNBATCHED: "likely a value that instances share (an attribute of the class, a variable of the module)",
}
RANDOM = "a tracker that draws random numbers says random = True"


class Company(NamedTuple):
    """The batch of the second drive."""

    order: Indices
    """``(width,)`` the member in each column: of the block, or, from ``members`` on, of the others."""
    members: int
    """Number of members of the block."""
    others: Sequence[Scan]
    """Scans of other scenes, in the order of those of the block."""

    def scan(self, scan: Scan, number: int | None) -> Scan:
        """The scan of the second batch where the first had ``scan``; ``number`` None where that has no measurement."""
        if number is None:
            return scan_of_columns(scan, self.order % self.members)
        other = self.others[number]
        if scan.valid.ndim == 2:
            most = max(len(scan.valid), len(other.valid))
            scan, other = _padded(scan, most), _padded(other, most)
        measurement = np.concatenate([scan.measurement, other.measurement], axis=-1)
        valid = np.concatenate([scan.valid, other.valid], axis=-1)
        return scan_of_columns(scan._replace(measurement=measurement, valid=valid), self.order)

    def before(self) -> list[Scan]:
        """What a process that serves several trackers is given before: the first scans of the other scenes alone."""
        width = np.arange(len(self.order))
        return [scan_of_columns(scan, width % scan.valid.shape[-1]) for scan in self.others[:BEFORE]]


class Disagreement(NamedTuple):
    """That, and where, the second drive told a member something else."""

    fault: TrackFault
    instant: int
    sensor: str


class SecondDrive:
    """Goes through the scans beside the first drive, and holds its estimates against those.

    Args:
        stepper: a fresh tracker for the company.
        company: the batch that it is given.
        batched: whether it takes its batch at once, so that members may differ by rounding; any other gives the same
            bits.
    """

    def __init__(self, stepper: Stepper, company: Company, batched: bool) -> None:
        self._stepper, self._company = stepper, company
        self._how, self._largest = (BATCHED, SAME) if batched else (UNBATCHED, 0.0)
        self._columns = np.flatnonzero(company.order < company.members)
        self._members = company.order[self._columns]
        self._ids: tuple[Indices, Indices] | None = None
        self.disagreement: Disagreement | None = None
        """The first one, after which it goes no further."""

    def take(self, step: DriveStep[Any]) -> None:
        """Take the step that the first drive took."""
        if self.disagreement is not None:
            return
        scan = self._company.scan(step.scan, step.number if step.read else None)
        problem: TrackFault | None
        try:
            other = self._stepper.step(scan)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            problem = self._failure(fault_of(error))
        else:
            problem = self._compared(step.answer, other)
        if problem is not None:
            self.disagreement = Disagreement(problem, step.instant, step.scan.sensor)
            self.close()

    def conclude(self) -> Disagreement | None:
        """Return where both drives differ, once all steps are taken."""
        return self.disagreement

    def close(self) -> None:
        """End the tracker."""
        self._stepper.close()

    def _failure(self, fault: TrackFault) -> TrackFault:
        """A failure of the second drive alone, of the member of the first where that has it."""
        member = None if fault.member is None else int(self._company.order[fault.member])
        if member is not None and member >= self._company.members:
            member = None
        return TrackFault(f"{self._how}, it fails: {fault.cause}", fault.kind, fault.place, member)

    def _compared(self, answer: Any, other: Any) -> TrackFault | None:
        """Hold the answer of the first drive against that of the second."""
        if isinstance(answer, Tracks):
            answer, other = _of_members(answer, self._members), _of_members(other, self._columns)
            renamed = self._renamed(answer.ids, other.ids)
            if renamed.any():
                return self._fault(int(np.argmax(renamed)), "a track goes on under another id")
        for what, value, again in self._pairs(answer, other):
            gap = _gap(value, again)
            if (gap > self._largest).any():
                member = int(np.argmax(gap))
                return self._fault(member, _difference(what, value[..., member], again[..., member], gap[member]))
        return None

    def _pairs(self, answer: Any, other: Any) -> Iterator[tuple[str, Array, Array]]:
        """The parts of both answers: arrays ``(..., members)`` of those that are in both drives."""
        if isinstance(answer, Tracks):
            for name in ("mean", "covariance", "existence", "used"):
                value, again = getattr(answer, name), getattr(other, name)
                if value is not None and again is not None:
                    yield name, *_as_many_tracks(value, again)
            return
        for name, shape in (("mean", (4,)), ("covariance", (4, 4))):
            value, again = (
                np.full((*shape, len(self._members)), np.nan) if of is None else getattr(of, name)[..., columns]
                for of, columns in ((answer, self._members), (other, self._columns))
            )
            yield name, value, again

    def _renamed(self, ids: Indices, others: Indices) -> Mask:
        """``(members,)`` where a track goes on from the scan before in one drive and not in the other."""
        before, self._ids = self._ids, (ids, others)
        if before is None or ids.shape != others.shape or before[0].shape != before[1].shape:
            return np.zeros(len(self._members), dtype=bool)
        goes_on, other_goes_on = (now[:, None] == then for now, then in zip((ids, others), before, strict=True))
        renamed: Mask = np.any(goes_on != other_goes_on, axis=(0, 1))
        return renamed

    def _fault(self, member: int, difference: str) -> TrackFault:
        text = f"{self._how}, it gives another estimate: {difference}; {CAUSES[self._how]}; {RANDOM}"
        return TrackFault(text, "answer", member=int(self._members[member]))


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


def _of_members(tracks: Tracks, members: Indices) -> Tracks:
    """The tracks of some runs, in the order of their ids: a shared counter may number them as it likes."""
    ids = tracks.ids[:, members]
    order = np.argsort(np.where(ids == NO_TRACK, np.iinfo(ids.dtype).max, ids), axis=0, kind="stable")
    order = order[: int((ids != NO_TRACK).sum(axis=0).max(initial=0))]
    parts = (None if part is None else part[..., order, members] for part in tracks)
    return Tracks(*parts)  # type: ignore[arg-type]


def _as_many_tracks(value: Array, again: Array) -> tuple[Array, Array]:
    """Two arrays ``(..., K, members)``, padded by NaN to the larger K."""
    most = max(value.shape[-2], again.shape[-2])
    first, second = (
        np.concatenate([of, np.full((*of.shape[:-2], most - of.shape[-2], of.shape[-1]), np.nan)], axis=-2)
        for of in (value, again)
    )
    return first, second


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

"""Scans that arrive after one that was taken later (out-of-sequence measurements)."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks
from trackbench.trackers.answers import NO_TRACK
from trackbench.trackers.config import LateMethod
from trackbench.trackers.track_steps import log_likelihood


class ProcessedScan(NamedTuple):
    """A scan in the history. It is never changed, so that a copied state shares its history."""

    before: Any
    """State of the tracker before the scan; None at first."""
    arguments: tuple[Any, ...]
    """The scan, and the origins of its detections for a tracker that knows them."""
    answer: Any
    """Estimate or tracks after the scan."""

    @property
    def scan(self) -> Scan:
        """The scan."""
        scan: Scan = self.arguments[0]
        return scan

    def __deepcopy__(self, memo: dict[int, Any]) -> ProcessedScan:
        return self


class LateState(NamedTuple):
    """The state of a tracker, and its latest scans."""

    own: Any = None
    """State of the tracker; None before its first scan."""
    history: tuple[ProcessedScan, ...] = ()
    """Scans of the lag, by the time at which they were taken."""


@dataclass(frozen=True)
class LateScans:
    """A built-in tracker of one object or of several, and what becomes of late scans.

    Left to itself a tracker drops a scan that is older than its state. With ``replay`` it goes back to the time of the
    scan and takes all later ones again. With ``as_new`` a scan counts as taken when it arrived.
    """

    tracker: Any
    """Has ``step``, and ``advances`` to say at the scans of which sensors its state moves on."""
    late: LateMethod = "replay"
    lag_s: float = 1.0
    """How far back a replay reaches, s."""

    batched: ClassVar = True

    def step(self, state: LateState | None, scan: Scan, *origins: Indices) -> tuple[LateState, Any]:
        """Take a scan, late or not; the answer is that at the time of the latest scan."""
        own, history = state or LateState()
        moves = self.tracker.advances(scan.sensor) and not scan.asked
        if moves and self.late == "as_new":
            scan = scan._replace(time=scan.arrival_time)
        if not moves or self.late != "replay":
            own, answer = self.tracker.step(own, scan, *origins)
            return LateState(own, history), answer
        number = _place_of_late(history, scan)
        if number is not None:
            return self._replayed(history, number, (scan, *origins))
        after, answer = self.tracker.step(own, scan, *origins)
        if not history or _order(history[-1].scan) <= _order(scan):
            first = bisect_left(history, scan.time - self.lag_s, key=lambda earlier: earlier.scan.time)
            history = (*history[first:], ProcessedScan(own, (scan, *origins), answer))
        return LateState(after, history), answer

    def _replayed(
        self, history: tuple[ProcessedScan, ...], number: int, arguments: tuple[Any, ...]
    ) -> tuple[LateState, Any]:
        """Take a late scan at its place in the history, and the later ones again."""
        before, redone, answers = history[number].before, [], []
        for each in (arguments, *(processed.arguments for processed in history[number:])):
            after, answer = self.tracker.step(before, *each)
            redone.append(ProcessedScan(before, each, answer))
            answers.append(answer)
            before = after
        gained = _total_log_likelihood(redone) - _total_log_likelihood(history[number:])
        return LateState(before, (*history[:number], *redone)), _with_late_answer(answers[-1], answers[0], gained)

    def reading_only(self, sensors: Collection[str] | None) -> LateScans:
        """Return this tracker, which reads no other sensors than these; None: as it is."""
        return replace(self, tracker=self.tracker.reading_only(sensors))

    def __getattr__(self, name: str) -> Any:
        """Attribute of the tracker, such as ``multi_object``."""
        if name == "tracker" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.tracker, name)

    def predicted(self, state: LateState, run: int) -> Tracks:
        """Return the tracks of one run as they were expected at the latest scan, of a tracker of several objects."""
        tracks: Tracks = self.tracker.predicted(state.own, run)
        return tracks


def _order(scan: Scan) -> tuple[float, int]:
    """Scans of one time are in the order in which they are delivered when nothing is late."""
    return scan.time, scan.place


def _place_of_late(history: tuple[ProcessedScan, ...], scan: Scan) -> int | None:
    """The index in the history; None where the scan is not late, or older than the history reaches back."""
    if not history or _order(history[-1].scan) <= _order(scan):
        return None
    number = sum(_order(processed.scan) <= _order(scan) for processed in history)
    before = history[0].before
    return None if number == 0 and before is not None and before.time > scan.time else number


def _with_late_answer(latest: Any, late: Any, gained: Array | float) -> Any:
    """The latest answer with what the late scan gave: its innovation, or the detections that tracks took from it."""
    if isinstance(latest, Estimate):
        return latest._replace(
            innovation=late.innovation,
            innovation_covariance=late.innovation_covariance,
            whitened_innovation=late.whitened_innovation,
            # Of the late scan given all that were processed before. Zero: no track was there for any of them.
            log_likelihood=np.where(gained == 0.0, np.nan, gained),
        )
    used = np.full(latest.ids.shape, NO_TRACK)
    for ids, column in zip(late.ids, late.used, strict=True):
        used = np.where((latest.ids == ids) & (ids != NO_TRACK), column, used)
    return latest._replace(used=used)


def _total_log_likelihood(history: Sequence[ProcessedScan]) -> Array | float:
    total: Array | float = 0.0
    for processed in history:
        logarithm = log_likelihood(processed.answer) if isinstance(processed.answer, Estimate) else None
        if logarithm is not None:
            total = total + np.where(processed.scan.valid & ~np.isnan(logarithm), logarithm, 0.0)
    return total

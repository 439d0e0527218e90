"""Out-of-sequence measurements: scans that arrive after a scan taken later."""

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
    """Scan that the tracker has processed, with the state before and the answer after it; never changed in place."""

    before: Any
    """State of the tracker before the scan; None before the tracker's first scan."""
    arguments: tuple[Any, ...]
    """Arguments of ``step``: the scan, and the origins of its detections for a tracker that uses them."""
    answer: Any
    """Estimate or tracks that the tracker returned for the scan."""

    @property
    def scan(self) -> Scan:
        scan: Scan = self.arguments[0]
        return scan

    def __deepcopy__(self, memo: dict[int, Any]) -> ProcessedScan:
        return self


class LateState(NamedTuple):
    """State of a tracker, with the history of its latest scans."""

    own: Any = None
    """State of the wrapped tracker; None before its first scan."""
    history: tuple[ProcessedScan, ...] = ()
    """Processed scans within the lag ``lag_s``, in acquisition order."""


@dataclass(frozen=True)
class LateScans:
    """Wrapper of a built-in single-object or multi-object tracker, with a rule for late scans.

    With ``drop`` the tracker drops a scan that is older than its state. With ``replay`` it goes back to the time of the
    scan and processes all later scans again. With ``as_new`` a scan counts as taken when it arrived.
    """

    tracker: Any
    """Tracker with ``step``, and with ``advances``, which says whether scans of a sensor move its state in time."""
    late: LateMethod = "replay"
    lag_s: float = 1.0
    """Longest delay of a scan that is still processed at its own time, s."""

    batched: ClassVar = True

    def step(self, state: LateState | None, scan: Scan, *origins: Indices) -> tuple[LateState, Any]:
        """Process a scan, late or not; return the new state, and the answer at the time of the latest scan."""
        tracker_state, history = state or LateState()
        advances = self.tracker.advances(scan.sensor) and not scan.asked
        if advances and self.late == "as_new":
            scan = scan._replace(time=scan.arrival_time)
        if not advances or self.late != "replay":
            tracker_state, answer = self.tracker.step(tracker_state, scan, *origins)
            return LateState(tracker_state, history), answer
        place = _place_of_late(history, scan)
        if place is not None:
            return self._replayed(history, place, (scan, *origins))
        after, answer = self.tracker.step(tracker_state, scan, *origins)
        if not history or _order(history[-1].scan) <= _order(scan):
            first = bisect_left(history, scan.time - self.lag_s, key=lambda earlier: earlier.scan.time)
            history = (*history[first:], ProcessedScan(tracker_state, (scan, *origins), answer))
        return LateState(after, history), answer

    def _replayed(
        self, history: tuple[ProcessedScan, ...], place: int, arguments: tuple[Any, ...]
    ) -> tuple[LateState, Any]:
        before, redone, answers = history[place].before, [], []
        for arguments_of_scan in (arguments, *(processed.arguments for processed in history[place:])):
            after, answer = self.tracker.step(before, *arguments_of_scan)
            redone.append(ProcessedScan(before, arguments_of_scan, answer))
            answers.append(answer)
            before = after
        gained = _total_log_likelihood(redone) - _total_log_likelihood(history[place:])
        return LateState(before, (*history[:place], *redone)), _with_late_answer(answers[-1], answers[0], gained)

    def reading_only(self, sensors: Collection[str] | None) -> LateScans:
        """Return this tracker restricted to the named sensors; this tracker itself for None."""
        return replace(self, tracker=self.tracker.reading_only(sensors))

    def __getattr__(self, name: str) -> Any:
        if name == "tracker" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.tracker, name)

    def predicted(self, state: LateState, run: int) -> Tracks:
        """Return the tracks of one run predicted to the latest scan; for multi-object trackers alone."""
        tracks: Tracks = self.tracker.predicted(state.own, run)
        return tracks


def _order(scan: Scan) -> tuple[float, int]:
    return scan.time, scan.place


def _place_of_late(history: tuple[ProcessedScan, ...], scan: Scan) -> int | None:
    """Return the index at which to insert a late scan in the history; None if it is not late, or too old for it."""
    if not history or _order(history[-1].scan) <= _order(scan):
        return None
    place = sum(_order(processed.scan) <= _order(scan) for processed in history)
    before = history[0].before
    return None if place == 0 and before is not None and before.time > scan.time else place


def _with_late_answer(latest: Any, late: Any, gained: Array | float) -> Any:
    if isinstance(latest, Estimate):
        return latest._replace(
            innovation=late.innovation,
            innovation_covariance=late.innovation_covariance,
            whitened_innovation=late.whitened_innovation,
            # Likelihood of the late scan given all earlier processed scans. Zero means that no scan had a track.
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

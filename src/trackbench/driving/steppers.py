"""Steps of trackers that are not built in, for a whole batch, and steps of smoothers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Scan, Tracks, scan_of_member, scan_of_run
from trackbench.driving.faults import fault_of
from trackbench.driving.frames import is_plain
from trackbench.driving.program import ProgramTracker
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import (
    ASYMMETRY,
    KEPT_THERE,
    NO_TRACK,
    TRACKS,
    Tracker,
    TrackerFault,
    checked_estimate,
    checked_tracks,
    is_random,
    require_continued,
    unpack,
)
from trackbench.trackers.filtered import SmoothedTracker
from trackbench.trackers.late import LateScans


def refuse_truth(tracker: Any) -> None:
    """Raise an error for a plug-in's tracker that starts from the ground truth, which plug-ins do not get.

    Raises:
        InputError: the filter starts from the truth.
    """
    if isinstance(tracker, LateScans) and tracker.starts_from_truth:
        message = "starts from the truth, which only a built-in filter is given; use another initial"
        raise InputError(message, key="initial")


class Offline:
    """Tracker around a smoother, which gets all scans before its first step.

    Args:
        tracker: the smoother.
        scans: all scans of the run, in the order of the steps.
    """

    def __init__(self, tracker: SmoothedTracker, scans: Sequence[Scan]) -> None:
        self._tracker, self._scans = tracker, scans

    def step(self, state: Iterator[Estimate] | None, scan: Scan) -> tuple[Iterator[Estimate], Estimate]:
        """Return the iterator over the estimates at later scans, and the estimate at this scan."""
        state = iter(self._tracker.estimates(self._scans)) if state is None else state
        return state, next(state)

    @property
    def engine_used(self) -> EngineUsed:
        """Engine that computed the smoother's steps."""
        return self._tracker.tracker.engine_used


class ForeignTracker:
    """Tracker that is not built in, stepped for all members of a batch, with checked answers.

    A batched tracker is stepped once a scan. Otherwise each member has a tracker of its own, stepped from the member's
    first measurement on. The trackers are in this process or in a program.

    Args:
        make: returns a fresh tracker.
        batch: number of members: tracks, or runs.
        several: whether the trackers follow several objects.
    """

    def __init__(self, make: Callable[[], Tracker], batch: int, several: bool) -> None:
        first = make()
        self.batched, self.random = bool(getattr(first, "batched", False)), is_random(first)
        self.program = first.program if isinstance(first, ProgramTracker) else None
        """Program that serves the trackers; None if they run in this process."""
        self._trackers: list[Any] = [first, *(make() for _ in range(0 if self.batched else batch - 1))]
        self._states: list[Any] = [None] * len(self._trackers)
        self._batch, self._several = batch, several
        self._members = list(range(len(self._trackers))) if self.batched or several else []
        """Indices of the batch members whose first measurement has come."""
        self._has_answered = np.zeros(len(self._trackers), dtype=bool)

    def step(self, state: object, scan: Scan) -> tuple[str, Any]:
        """Return a placeholder for the state, and the answer for all members; None before the first estimate.

        Raises:
            TrackFault: a tracker failed or gave an invalid answer; an unbatched tracker's fault names the member.
        """
        if len(self._members) < len(self._trackers):
            self._members = sorted({*self._members, *np.flatnonzero(scan.valid).tolist()})
        members = self._members
        if self.batched:
            scans = [scan]
        else:
            scans = [(scan_of_run if self._several else scan_of_member)(scan, member) for member in members]
        answers = self._answers(members, scans)
        batch = scan.valid.shape if self.batched else ()
        plain = None if self._several else plain_estimate(answers, batch)
        if plain is None:
            return KEPT_THERE, self._checked(members, scans, answers)
        if len(members) == len(self._trackers):
            self._has_answered[:] = True
            return KEPT_THERE, plain
        self._has_answered[members] = True
        mean, covariance = np.full((4, self._batch), np.nan), np.full((4, 4, self._batch), np.nan)
        mean[:, members], covariance[:, :, members] = plain.mean, plain.covariance
        return KEPT_THERE, Estimate(mean, covariance)

    def close(self) -> None:
        """End the program that serves the trackers, if there is one."""
        if self.program is not None:
            self.program.close()

    def _answers(self, members: Sequence[int], scans: Sequence[Scan]) -> list[Any]:
        if self.program is not None:
            numbers = [self._trackers[member].number for member in members]
            return self.program.ask(numbers, scans, None if self.batched else members)
        answers = []
        for member, scan in zip(members, scans, strict=True):
            try:
                step = self._trackers[member].step(self._states[member], scan)
                self._states[member], answer = unpack(step, TRACKS if self._several else "estimate")
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                raise fault_of(error, None if self.batched else member) from error
            answers.append(answer)
        return answers

    def _checked(self, members: Sequence[int], scans: Sequence[Scan], answers: Sequence[Any]) -> Any:
        checked: list[Any] = [None] * len(self._trackers)
        for member, scan, unchecked in zip(members, scans, answers, strict=True):
            try:
                answer = (checked_tracks if self._several else checked_estimate)(unchecked, scan)
                require_continued(answer, bool(self._has_answered[member]), finite=not self.batched)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                raise fault_of(error, None if self.batched else member) from error
            checked[member] = answer
            self._has_answered[member] = answer is not None
        if self.batched:
            return checked[0]
        return joined_tracks(checked) if self._several else joined_estimates(checked)


def plain_estimate(answers: Sequence[Any], batch: tuple[int, ...]) -> Estimate | None:
    """Return answers joined to one estimate if all are valid, and only a mean and a covariance each; else None.

    Checking all answers at once is faster than one by one.

    Args:
        answers: answers of single members, or one answer of a batch.
        batch: trailing axes of each answer.
    """
    for answer in answers:
        if not is_plain(answer) or answer[0].shape != (4, *batch) or answer[1].shape != (4, 4, *batch):
            return None
    if not answers:
        return None
    if batch:
        mean, covariance = answers[0][:2]
    elif len(answers) == 1:
        mean, covariance = answers[0][0].reshape(4, 1), answers[0][1].reshape(4, 4, 1)
    else:
        mean = np.array([answer[0] for answer in answers]).T.copy()
        covariance = np.array([answer[1] for answer in answers]).transpose(1, 2, 0).copy()
    if not math.isfinite(np.vdot(mean, mean) + np.vdot(covariance, covariance)):
        return None
    mirrored = covariance.swapaxes(0, 1)
    # Comparing bytes is faster than comparing numbers.
    if mirrored.tobytes() != covariance.tobytes():
        gap = np.abs(covariance - mirrored).max()
        if gap > ASYMMETRY * covariance.max(axis=(0, 1)).min():
            return None
    return Estimate(mean, covariance)


def joined_estimates(answers: Sequence[Estimate | None]) -> Estimate | None:
    """Join estimates along a last axis of members, with NaN for a member without one; None if no member has one.

    Raises:
        TrackerFault: the sizes of innovations or mode probabilities differ between members.
    """
    for name in ("mode_probabilities", "innovation"):
        values = [getattr(answer, name, None) for answer in answers]
        sizes = sorted({len(value) for value in values if value is not None})
        if len(sizes) > 1:
            raise TrackerFault(f"it gave {' and '.join(map(str, sizes))} {name.replace('_', ' ')}")
    means, covariances = _joined(answers, "mean"), _joined(answers, "covariance")
    if means is None or covariances is None:
        return None
    with_innovation = [
        answer
        if answer is not None and answer.innovation is not None and answer.innovation_covariance is not None
        else None
        for answer in answers
    ]
    innovation = _joined(with_innovation, "innovation")
    if innovation is not None and np.isnan(innovation).all():
        innovation = None
    return Estimate(
        means,
        covariances,
        innovation=innovation,
        innovation_covariance=None if innovation is None else _joined(with_innovation, "innovation_covariance"),
        repaired=np.array([bool(getattr(answer, "repaired", False)) for answer in answers]),
        mode_probabilities=_joined(answers, "mode_probabilities"),
    )


def joined_tracks(answers: Sequence[Tracks]) -> Tracks:
    """Join the tracks of several runs along a last axis of runs, padded to equal numbers of tracks."""
    fills = {"ids": NO_TRACK, "used": NO_TRACK}
    return Tracks(*(_joined(answers, name, fills.get(name, np.nan)) for name in Tracks._fields))  # type: ignore[arg-type]


def _joined(answers: Sequence[Any], name: str, fill: float = np.nan) -> Array | None:
    """Return one field of all answers along a last axis of members, padded; None if no answer has the field."""
    values = [getattr(answer, name, None) for answer in answers]
    shapes = [value.shape for value in values if value is not None]
    if not shapes:
        return None
    result = np.full((*np.max(shapes, axis=0), len(values)), fill)
    for member, value in enumerate(values):
        if value is not None:
            index: tuple[Any, ...] = (*map(slice, value.shape), member)
            result[index] = value
    return result

"""Any tracker as one that takes a whole batch, its answers checked."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks, scan_of_member, scan_of_run
from trackbench.driving.faults import fault_of
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import (
    NO_TRACK,
    TRACKS,
    Tracker,
    TrackerFault,
    checked_estimate,
    checked_tracks,
    is_random,
    require_kept,
    unpack,
)
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import SmoothedTracker
from trackbench.trackers.late import LateScans
from trackbench.trackers.multi import build_multi
from trackbench.trackers.published import create

Answer = TypeVar("Answer")


class Traits(NamedTuple):
    """What a tracker says of itself."""

    batched: bool
    """Whether it takes every member of a batch at once."""
    random: bool = False
    """Whether it draws random numbers."""


class Stepper(ABC):
    """A tracker made ready for a batch: of tracks, or of runs with several objects each."""

    traits = Traits(batched=True)

    @abstractmethod
    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """The estimate of every member, None while there is none; or the tracks of all runs, ids padded with -1.

        Args:
            scan: ``measurement`` ``(m, batch)``, with hidden identities ``(m, D, runs)``.
            origins: ``(2, D, runs)`` the objects that each detection stems from, for the tracker that knows them.
        """

    @property
    def engine_used(self) -> EngineUsed | None:
        """What computed the steps so far; None of a tracker that is not built in."""
        return None

    def close(self) -> None:  # noqa: B027 - in this process nothing is left to end
        """It is no longer needed."""


#: Sets the engine and the first states of a built-in tracker.
Prepare = Callable[[Any], Any]


def local(
    config: FilterConfig | PluginConfig, folder: Path | None, batch: int, prepare: Prepare, several: bool = False
) -> Stepper:
    """A fresh tracker in this process, as a scenario names it.

    Args:
        config: the scenario's entry.
        folder: where a tracker's module is looked for first.
        batch: how many tracks, or runs, it follows at once.
        prepare: sets the engine of a built-in tracker, and its first states where it starts from the truth.
        several: whether it follows several objects.

    Raises:
        InputError: a plug-in cannot be found or does not take its options, or it is a smoother.
    """
    form = TRACKS_FORM if several else ESTIMATE_FORM
    if isinstance(config, FilterConfig):
        if several:
            return DirectTracks(prepare(build_multi(config)))
        if config.smoother is not None:
            raise InputError("a smoother needs all measurements of a run; remove it", key="smoother")
        return Direct(prepare(build(config)))
    make = create(config.reference, config.options, folder)
    tracker = make()
    if isinstance(tracker, LateScans) and not several:
        return Direct(prepare(refuse_truth(tracker).reading_only(config.sensors)))
    return Batched(tracker, form) if getattr(tracker, "batched", False) else Looped(make, batch, form)


def refuse_truth(tracker: LateScans) -> LateScans:
    """A filter that a plug-in has made, which is given no truth.

    Raises:
        InputError: it starts from the truth.
    """
    if tracker.starts_from_truth:
        message = "starts from the truth, which only a built-in filter is given; use another initial"
        raise InputError(message, key="initial")
    return tracker


class Direct(Stepper):
    """A built-in tracker of one object, whose answers have the right form by construction."""

    def __init__(self, tracker: Any) -> None:
        self.tracker = tracker
        self.state: Any = None

    def step(self, scan: Scan, origins: Indices | None = None) -> Estimate:
        """Estimates of every member of the batch."""
        estimate: Estimate
        self.state, estimate = self.tracker.step(self.state, scan)
        return estimate

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        used: EngineUsed = self.tracker.engine_used
        return used


class DirectTracks(Stepper):
    """A built-in tracker of several objects, whose answers have the right form by construction."""

    def __init__(self, tracker: Any) -> None:
        self.tracker = tracker
        self._state: Any = None

    def step(self, scan: Scan, origins: Indices | None = None) -> Tracks:
        """The tracks of all runs."""
        wanted = (origins,) if self.tracker.wants_origins else ()
        tracks: Tracks
        self._state, tracks = self.tracker.step(self._state, scan, *wanted)
        return tracks

    def predicted(self, run: int) -> Tracks:
        """The tracks of one run as they were expected at the latest scan, before its detections."""
        tracks: Tracks = self.tracker.predicted(self._state, run)
        return tracks

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps so far."""
        used: EngineUsed = self.tracker.engine_used
        return used


class Offline(Stepper):
    """A smoother, which gets all scans before the first step."""

    def __init__(self, tracker: SmoothedTracker, scans: Sequence[Scan]) -> None:
        self._tracker, self._scans = tracker, scans
        self._estimates: Iterator[Estimate] | None = None

    def step(self, scan: Scan, origins: Indices | None = None) -> Estimate:
        """Estimates of every member of the batch at the next scan."""
        if self._estimates is None:
            self._estimates = iter(self._tracker.estimates(self._scans))
        return next(self._estimates)

    @property
    def engine_used(self) -> EngineUsed:
        """What computed the steps."""
        return self._tracker.tracker.engine_used


class AnswerForm(NamedTuple):
    """What a tracker answers, of one object or of several."""

    kind: type[Estimate] | type[Tracks]
    check: Callable[[Any, Scan], Any]
    """Makes an answer one of the right form, or raises a TrackerFault."""
    what: str
    """``step`` returns beside the state, in messages."""
    joined: Callable[[Any], Any]
    """One answer from those of all members."""


class Stateful(Generic[Answer]):
    """A tracker with its state.

    Args:
        tracker: a fresh one.
        check: makes its answer to a scan one of the right form, or raises.
        what: ``step`` has to return beside the state, in messages.
    """

    def __init__(self, tracker: Any, check: Callable[[Any, Scan], Answer], what: str = "estimate") -> None:
        self.tracker = tracker
        self.state: Any = None
        self._check, self._what = check, what

    @property
    def batched(self) -> bool:
        """Whether it says that it takes a batch at once."""
        return bool(getattr(self.tracker, "batched", False))

    def step(self, scan: Scan, *more: Any) -> Answer:
        """The answer to a scan; ``more``: what else the tracker is given.

        Raises:
            TrackerFault: what it returned is no answer.
        """
        self.state, unchecked = unpack(self.tracker.step(self.state, scan, *more), self._what)
        return self._check(unchecked, scan)

    def copied(self) -> Self:
        """An independent one with the same state, by ``copy.deepcopy``, which raises whatever a tracker raises.

        Raises:
            TrackbenchError: the tracker has a destructor.
        """
        if hasattr(self.tracker, "__del__") and not hasattr(self.tracker, "__deepcopy__"):
            raise TrackbenchError("it has a destructor, which the end of a copy would call")
        twin = copy.copy(self)
        twin.tracker, twin.state = copy.deepcopy((self.tracker, self.state))
        return twin


class Batched(Stepper):
    """A tracker that steps every member of the batch at once."""

    def __init__(self, tracker: Any, form: AnswerForm) -> None:
        self._tracker = Stateful(tracker, form.check, form.what)
        self._wants_origins = form.kind is Tracks and bool(getattr(tracker, "wants_origins", False))
        self._estimated = False
        self.traits = Traits(batched=True, random=is_random(tracker))

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """Answers of every member of the batch, or None before the first."""
        answer = self._tracker.step(scan, *((origins,) if self._wants_origins else ()))
        require_kept(answer, self._estimated, finite=False)
        self._estimated = answer is not None
        return answer


class Looped(Stepper):
    """A tracker of one track, or of one run: a fresh one for each member.

    A tracker of one object is called from the member's first measurement on.
    """

    def __init__(self, make: Callable[[], Tracker], batch: int, form: AnswerForm) -> None:
        self._trackers = [Stateful(make(), form.check, form.what) for _ in range(batch)]
        self._form = form
        self._begun = [form.kind is Tracks] * batch
        self._estimated = [False] * batch
        self.traits = Traits(batched=False, random=any(is_random(each.tracker) for each in self._trackers))

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """Step every member that has begun.

        Raises:
            TrackFault: a member's tracker raised, or its answer has the wrong form.
        """
        answers = []
        for member in range(len(self._trackers)):
            try:
                answers.append(self._answer(member, scan))
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                raise fault_of(error, member) from error
        return self._form.joined(answers)

    def _answer(self, member: int, scan: Scan) -> Any:
        own = scan_of_run(scan, member) if scan.valid.ndim == 2 else scan_of_member(scan, member)
        self._begun[member] = self._begun[member] or bool(own.valid)
        if not self._begun[member]:
            return None
        answer = self._trackers[member].step(own)
        require_kept(answer, self._estimated[member])
        self._estimated[member] = answer is not None
        return answer


def joined_estimates(answers: Sequence[Estimate | None]) -> Estimate | None:
    """One estimate with a last axis of members; NaN where there is none.

    Raises:
        TrackerFault: innovations or mode probabilities of several sizes.
    """
    whole = [answer for answer in answers if answer is not None and all(part is None for part in answer[2:])]
    if 0 < len(whole) == len(answers):
        # Most trackers say no more than that, and it is joined in less time.
        mean = np.array([answer.mean for answer in whole]).T.copy()
        covariance = np.array([answer.covariance for answer in whole]).transpose(1, 2, 0).copy()
        return Estimate(mean, covariance)
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
    """The tracks of several runs with a last axis of runs, padded."""
    fills = {"ids": NO_TRACK, "used": NO_TRACK}
    return Tracks(*(_joined(answers, name, fills.get(name, np.nan)) for name in Tracks._fields))  # type: ignore[arg-type]


def _joined(answers: Sequence[Any], name: str, fill: float = np.nan) -> Array | None:
    """One field of all answers with a last axis of members, padded; None where no answer has it."""
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


ESTIMATE_FORM = AnswerForm(Estimate, checked_estimate, "estimate", joined_estimates)
TRACKS_FORM = AnswerForm(Tracks, checked_tracks, TRACKS, joined_tracks)

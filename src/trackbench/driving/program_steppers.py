"""Trackers that a program serves: of a batch, and as they are."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Indices, Scan, Tracks, scan_of_member, scan_of_run
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.frames import ScanFrames, id_of, message_estimate, plain_estimate, tracks_of
from trackbench.driving.program import Program
from trackbench.driving.steppers import ESTIMATE_FORM, TRACKS_FORM, Stepper, Traits
from trackbench.trackers.answers import KEPT_THERE, OF_ONE, OF_SEVERAL, TrackerFault, require_kept

Message = dict[str, Any]


def answer_of(message: Mapping[str, Any], several: bool) -> Estimate | Tracks | None:
    """What an answer says.

    Raises:
        TrackerFault: it is of the other kind of tracker, or has no arrays of the right form.
    """
    kind = message["type"]
    if kind == "none":
        return None
    if (kind == "tracks") != several:
        raise TrackerFault(OF_ONE if several else OF_SEVERAL)
    return tracks_of(message) if several else message_estimate(message)


class ProgramStepper(Stepper):
    """A batch whose trackers are in a program: one that takes batches has one of them, any other one for each member.

    Args:
        program: which may serve others, too.
        batch: members.
        several: whether it follows several objects.
    """

    def __init__(self, program: Program, batch: int, several: bool) -> None:
        self._program, self._several, self._batch = program, several, batch
        self._form = TRACKS_FORM if several else ESTIMATE_FORM
        self.traits = Traits(program.batched and not program.separate, program.random)
        self._begin()

    def _begin(self) -> None:
        self._numbers = [self._program.start() for _ in range(1 if self._program.batched else self._batch)]
        self._members = list(range(self._batch)) if self._several else []
        self._begun, self._estimated = (np.zeros(self._batch, dtype=bool) for _ in range(2))

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """The answer for all members, of one object from the first measurement on; their origins are not sent.

        Raises:
            TrackFault: the program failed, for one member where it takes no batches.
        """
        if self._program.batched:
            return self._together(scan)
        if len(self._members) < self._batch:
            self._begun |= scan.valid
            self._members = self._begun.nonzero()[0].tolist()
        if not self._members:
            return None
        estimate, messages = self._one_by_one(scan)
        if estimate is None:
            answers: list[Any] = [None] * self._batch
            for member, message in zip(self._members, messages, strict=True):
                answers[member] = self._checked(message, self._own(scan, member), member)
            return self._form.joined(answers)
        if len(self._members) == self._batch:
            self._estimated[:] = True
            return estimate
        self._estimated[self._members] = True
        mean, covariance = np.full((4, self._batch), np.nan), np.full((4, 4, self._batch), np.nan)
        mean[:, self._members], covariance[:, :, self._members] = estimate.mean, estimate.covariance
        return Estimate(mean, covariance)

    def restart(self, scans: Sequence[Scan]) -> None:
        """Follow some scans, and then start anew: the trackers that follow are not the first of their process."""
        for scan in scans:
            self.step(scan)
        self.__del__()
        self._begin()

    def close(self) -> None:
        """End the program."""
        self._program.close()

    def __deepcopy__(self, memo: object) -> ProgramStepper:
        twin = copy.copy(self)
        twin._numbers = list(map(self._program.copy, self._numbers))
        twin._begun, twin._estimated = self._begun.copy(), self._estimated.copy()
        return twin

    def __del__(self) -> None:
        for number in self._numbers:
            self._program.end(number)

    def _together(self, scan: Scan) -> Any:
        message = self._program.ask(self._numbers[0], scan)
        if not self._several and (estimate := plain_estimate([message], self._batch)):
            self._estimated[:] = True
            return estimate
        return self._checked(message, scan)

    def _one_by_one(self, scan: Scan) -> tuple[Estimate | None, list[Message]]:
        """The estimate of those who have begun; where it needs a closer look one message for each."""
        frames = ScanFrames(scan)
        self._program.send([frames.of(id_of(self._numbers[m]), self._own(scan, m)) for m in self._members])
        messages = [self._received(member) for member in self._members]
        return None if self._several else plain_estimate(messages), messages

    def _received(self, member: int) -> Message:
        try:
            return self._program.answer(self._numbers[member])
        except TrackFault as fault:
            fault.member = member
            raise

    def _own(self, scan: Scan, member: int) -> Scan:
        return scan_of_run(scan, member) if self._several else scan_of_member(scan, member)

    def _checked(self, message: Message, scan: Scan, member: int | None = None) -> Any:
        """The answer of a member, or of a tracker that takes batches."""
        estimated = self._estimated[slice(None) if member is None else slice(member, member + 1)]
        try:
            answer = self._form.check(answer_of(message, self._several), scan)
            require_kept(answer, bool(estimated.any()), finite=member is not None)
        except TrackerFault as error:
            raise fault_of(error, member) from error
        estimated[:] = answer is not None
        return answer


class ProgramTracker:
    """A tracker in a program, which also has its state."""

    def __init__(self, program: Program, several: bool = False, number: int | None = None) -> None:
        self._program, self._several = program, several
        self._number = program.start() if number is None else number
        self.batched, self.random = program.batched, program.random

    def step(self, state: str | None, scan: Scan) -> tuple[str, Any]:
        """What stands for its state, and the answer."""
        return KEPT_THERE, answer_of(self._program.ask(self._number, scan), self._several)

    @property
    def not_copied(self) -> str | None:
        """Why its program repeats it on the same scans instead of copying it; None while it has not."""
        return self._program.not_copied

    def __deepcopy__(self, memo: object) -> ProgramTracker:
        return ProgramTracker(self._program, self._several, self._program.copy(self._number))

    def __del__(self) -> None:
        self._program.end(self._number)

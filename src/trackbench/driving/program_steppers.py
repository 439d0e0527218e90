"""Trackers that a program in another language serves: of a batch, and as they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Indices, Scan, Tracks, scan_of_member, scan_of_run
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.frames import FLOAT, NotAFrame, ScanFrames, estimate_of, plain_estimate, tracks_of
from trackbench.driving.program import Program
from trackbench.driving.steppers import ESTIMATE_FORM, TRACKS_FORM, Stepper, Traits
from trackbench.trackers.answers import GIVEN_UP, NOT_FINITE, OF_ONE, TrackerFault

Message = dict[str, Any]
#: Stands for the state of a tracker that has it in its program.
KEPT_THERE = "kept in the program"


def answer_of(message: Message, several: bool) -> Estimate | Tracks | None:
    """What an answer says.

    Raises:
        TrackerFault: it is of the other kind of tracker, or has no arrays of the right form.
    """
    kind = message["type"]
    if kind == "none":
        return None
    if (kind == "tracks") != several:
        raise TrackerFault(OF_ONE if several else "it gave tracks; with known identities an estimate is needed")
    try:
        return tracks_of(message) if several else estimate_of(message)
    except NotAFrame as error:
        raise TrackerFault(f"its answer is wrong: {error}") from None


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
        self.traits = Traits(program.batched, program.random)
        self._begin()

    def _begin(self) -> None:
        self._numbers = [self._program.start() for _ in range(1 if self.traits.batched else self._batch)]
        self._begun, self._estimated = (np.zeros(self._batch, dtype=bool) for _ in range(2))

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """The answer for all members; their origins are not sent.

        Raises:
            TrackFault: the program failed, for one member where it takes no batches.
        """
        if self.traits.batched:
            return self._together(scan)
        return self._tracks(scan) if self._several else self._estimates(scan)

    def restart(self, scans: Sequence[Scan]) -> None:
        """Follow some scans, and then start anew: the trackers that follow are not the first of their process."""
        for scan in scans:
            self.step(scan)
        for number in self._numbers:
            self._program.end(number)
        self._begin()

    def close(self) -> None:
        """End the program."""
        self._program.close()

    def _together(self, scan: Scan) -> Any:
        message = self._program.ask(self._numbers[0], scan)
        if self._batch == 1 and (plain := plain_estimate(message, [4, 1], [4, 4, 1])):
            self._estimated[:] = True
            mean, covariance = (np.frombuffer(bytearray(part), dtype=FLOAT) for part in plain)
            return Estimate(mean.reshape(4, 1), covariance.reshape(4, 4, 1))
        try:
            answer = self._form.check(answer_of(message, self._several), scan)
            if answer is None and self._estimated.any():
                raise TrackerFault(GIVEN_UP)
        except TrackerFault as fault:
            raise fault_of(fault) from fault
        self._estimated[:] = answer is not None
        return answer

    def _tracks(self, scan: Scan) -> Any:
        frames, own = ScanFrames(scan), [scan_of_run(scan, run) for run in range(self._batch)]
        self._program.send(
            [frames.of(number, each.measurement, each.valid) for number, each in zip(self._numbers, own, strict=True)]
        )
        answers = [self._checked(self._received(member), member, each) for member, each in enumerate(own)]
        return self._form.joined(answers)

    def _estimates(self, scan: Scan) -> Any:
        self._begun |= scan.valid
        members = self._begun.nonzero()[0].tolist()
        numbers = self._numbers if len(members) == self._batch else [self._numbers[member] for member in members]
        measurements = scan.measurement.T
        if len(members) < self._batch:
            measurements, valid = measurements[members], scan.valid[members].tolist()
        else:
            valid = scan.valid.tolist()
        self._program.send(ScanFrames(scan).of_each(numbers, measurements, valid))
        answers = [self._received(member) for member in members]
        plain = [plain_estimate(answer, [4], [4, 4]) for answer in answers]
        if not all(plain):
            return self._with_more(dict(zip(members, answers, strict=True)), scan)
        self._estimated[members] = True
        if not members:
            return None
        count = len(members)
        mean, covariance = (np.frombuffer(bytearray(b"".join(part)), dtype=FLOAT) for part in zip(*plain, strict=True))
        mean, covariance = mean.reshape(count, 4).T, covariance.reshape(count, 4, 4).transpose(1, 2, 0)
        if count < self._batch:
            there = (np.full((4, self._batch), np.nan), np.full((4, 4, self._batch), np.nan))
            there[0][:, members], there[1][:, :, members] = mean, covariance
            mean, covariance = there
        return Estimate(np.ascontiguousarray(mean), np.ascontiguousarray(covariance))

    def _with_more(self, messages: dict[int, Message], scan: Scan) -> Any:
        """The estimates where some members have none, or say more than mean and covariance."""
        answers: list[Any] = [None] * self._batch
        for member, message in messages.items():
            answers[member] = self._checked(message, member, scan_of_member(scan, member))
            self._estimated[member] = answers[member] is not None
        return self._form.joined(answers)

    def _received(self, member: int) -> Message:
        try:
            return self._program.receive(self._numbers[member])
        except TrackFault as fault:
            fault.member = member
            raise

    def _checked(self, message: Message, member: int, scan: Scan) -> Any:
        try:
            answer = self._form.check(answer_of(message, self._several), scan)
            if answer is None and self._estimated[member]:
                raise TrackerFault(GIVEN_UP)
            if isinstance(answer, Estimate) and not np.isfinite(answer.mean.sum() + answer.covariance.sum()):
                raise TrackerFault(NOT_FINITE)
        except TrackerFault as error:
            raise fault_of(error, member) from error
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

    def __deepcopy__(self, memo: object) -> ProgramTracker:
        if not self._program.copies:
            raise TypeError("its program does not say that it copies trackers")
        return ProgramTracker(self._program, self._several, self._program.copy(self._number))

    def __del__(self) -> None:
        self._program.end(self._number)

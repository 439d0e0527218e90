"""A program that serves trackers, as the bench speaks to it: one in another language, or the host of one in Python."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from trackbench.base import notebook_classes
from trackbench.base.errors import InputError, TrackbenchError, shortened_text
from trackbench.base.types import Scan
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.frames import VERSION, message_answer, message_frame, packed_array, scan_frames
from trackbench.driving.isolation import Isolation
from trackbench.driving.process import HOST, SHOWN, TrackerProcess
from trackbench.models.sensors import Sensor
from trackbench.trackers.answers import KEPT_THERE, TrackerFault
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.foreign import Command

#: Bytes of scans that are on their way at once: a pipe holds as many, so that neither side waits for the other to read.
ON_THE_WAY = 1 << 15


class Program(TrackerProcess):
    """A program that serves trackers, each with a number.

    Args:
        config: names it, or a class of Python.
        folder: where its path starts, and where it runs; of a class where its module is looked for first.
        isolation: the longest that it may take to answer, and the most memory.
        several: whether it is to follow several objects.
        batch: number of members that the bench follows at once; 0 of a class that is only to be found.
        sensors: of the scenario, by name.

    Raises:
        InputError: there is no such program or class, or it does not take the options.
        TrackFault: it does not answer, or not as the protocol says.
    """

    def __init__(
        self,
        config: PluginConfig,
        folder: Path | None,
        isolation: Isolation,
        several: bool,
        batch: int = 1,
        sensors: Mapping[str, Sensor] = {},
    ) -> None:
        if not hasattr(os, "fork"):
            raise InputError(f"{platform.system()} has no os.fork, by which a tracker gets a process; use --in-process")
        hello = _hello(config, several, batch, sensors)
        if isinstance(config.use, Command):
            command, name = config.use.resolved(folder), f"{config.use.name}: "
            super().__init__(isolation, command, str((folder or Path.cwd()).resolve()), name)
        else:
            super().__init__(isolation, *host_command(config.reference, folder))
        self.members, self._several, self._numbers = batch, several, 0
        try:
            self.send(hello)
            self._understand(self.receive())
        except BaseException:
            self.close()
            raise

    def start(self) -> int:
        """Start a fresh tracker; return its number."""
        self._numbers += 1
        self._unsent += message_frame({"type": "start", "id": self._numbers})
        return self._numbers

    def copy(self, number: int) -> int:
        """Copy a tracker with its state; return the number of the copy.

        Raises:
            TrackbenchError: the program does not copy it.
            TrackFault: its process has ended.
        """
        if not self.copies:
            raise TrackbenchError("its program does not say that it copies trackers")
        self._numbers += 1
        self._unsent += message_frame({"type": "copy", "id": self._numbers, "of": number})
        if self.confirms:
            self.send()
            try:
                self.receive()
            except TrackFault as fault:
                if self.fault is not None:
                    raise
                raise TrackbenchError(fault.cause) from fault
        return self._numbers

    def end(self, number: int) -> None:
        """Let the program forget a tracker."""
        if self.fault is None:
            self._unsent += message_frame({"type": "end", "id": number})

    def ask(self, numbers: Sequence[int], scans: Sequence[Scan], members: Sequence[int] | None = None) -> list[Any]:
        """Give each of some trackers a scan; return their answers, of which the form is not checked.

        Args:
            numbers: of the trackers.
            scans: one for each.
            members: of the batch, each of which has one of these trackers; None of a tracker for all members.

        Raises:
            TrackFault: a tracker failed; the process has ended, is late, or answered something else.
        """
        frames, answers = scan_frames(numbers, scans), list[Any]()
        at_once = max(1, ON_THE_WAY // max(map(len, frames), default=1))
        for first in range(0, len(frames), at_once):
            self.send(*frames[first : first + at_once])
            for number in numbers[first : first + at_once]:
                try:
                    answers.append(self._answer(number))
                except (TrackFault, TrackerFault) as error:
                    fault = fault_of(error)
                    fault.member = fault.member if members is None else members[len(answers)]
                    raise fault from error
        return answers

    def __deepcopy__(self, memo: object) -> Program:
        # Its trackers are copied, each by itself.
        return self

    def _answer(self, number: int) -> Any:
        answer = self.receive()
        kind = answer.get("type")
        if kind not in ("estimate", "none", "tracks") or answer.get("id") != number:
            asked = f"a scan of tracker {number}"
            raise self.failed(f"it answered {asked} with {_said(kind)} of {_said(answer.get('id'))}")
        return message_answer(answer, self._several)

    def _understand(self, answer: Mapping[str, Any]) -> None:
        version = answer.get("version")
        if answer.get("type") != "hello" or type(version) is not int:
            raise self.failed(f"it answered hello with {_said(answer.get('type'))}, where hello with a version is due")
        if version != VERSION:
            raise self.failed(f"it speaks version {version} of the protocol, and this trackbench {VERSION}")
        self.batched, self.random, self.copies, self.confirms = (
            answer.get(name) is True for name in ("batched", "random", "copies", "confirms")
        )


class ProgramTracker:
    """A tracker in a program, which also has its state."""

    def __init__(self, program: Program, number: int | None = None) -> None:
        self.program, self.number = program, program.start() if number is None else number
        self.batched, self.random = program.batched, program.random

    def step(self, state: str | None, scan: Scan) -> tuple[str, Any]:
        """Return what stands for its state, and the answer."""
        return KEPT_THERE, self.program.ask([self.number], [scan])[0]

    def __deepcopy__(self, memo: object) -> ProgramTracker:
        return ProgramTracker(self.program, self.program.copy(self.number))

    def __del__(self) -> None:
        self.program.end(self.number)


def host_command(reference: str, folder: Path | None = None) -> tuple[list[str], str]:
    """Return the command of a tracker in Python, and its working directory.

    Args:
        reference: ``module:Class`` or a published name.
        folder: where its module is looked for first.
    """
    here = "."
    # It may have been deleted.
    with suppress(FileNotFoundError):
        here = os.getcwd()
    return [*HOST, reference, *([] if folder is None else ["--folder", str(folder)])], here


def _hello(config: PluginConfig, several: bool, batch: int, sensors: Mapping[str, Sensor]) -> bytes:
    hello = {
        "type": "hello",
        "version": VERSION,
        "identities": "hidden" if several else "known",
        "batch": batch,
        "sensors": [
            {
                "name": name,
                "kind": sensor.type,
                "components": list(sensor.components),
                "noise_covariance": packed_array(sensor.noise_covariance()),
            }
            for name, sensor in sensors.items()
        ],
        "options": config.options,
    }
    if not isinstance(config.use, Command):
        hello["classes"] = notebook_classes.dumps(None)
    try:
        return message_frame(hello)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"its process cannot be told these options: {error}") from None


def _said(value: Any) -> str:
    return shortened_text(repr(value), SHOWN)

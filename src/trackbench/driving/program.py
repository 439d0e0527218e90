"""Client of a program that serves trackers: a program in another language, or the host of a Python tracker."""

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

#: Bytes of scans sent before answers are read: a pipe holds as many, so that neither side blocks the other.
ON_THE_WAY = 1 << 15


class Program(TrackerProcess):
    """Process of a program that serves several trackers, told apart by protocol numbers.

    Args:
        config: the tracker's settings in the scenario, which name the program or the Python class.
        folder: working directory of a program and start of its path; for a class, first folder to look for its module.
        isolation: limits of time and memory.
        several: whether the trackers follow several objects.
        batch: number of members of the batch followed at once; 0 only checks that the class exists.
        sensors: sensors of the scenario by name.

    Raises:
        InputError: the program or class does not exist, or does not take the options.
        TrackFault: the program does not answer by the protocol.
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
            working_folder = str((folder or Path.cwd()).resolve())
        else:
            (command, working_folder), name = host_command(config.reference, folder), ""
        super().__init__(isolation, command, working_folder, name)
        self.members, self._several, self._numbers = batch, several, 0
        try:
            self.send(hello)
            self._understand(self.receive())
        except BaseException:
            self.close()
            raise

    def start(self) -> int:
        """Start a fresh tracker in the program; return its protocol number."""
        self._numbers += 1
        self._unsent += message_frame({"type": "start", "id": self._numbers})
        return self._numbers

    def copy(self, number: int) -> int:
        """Copy the tracker with a protocol number and its state; return the number of the copy.

        Raises:
            TrackbenchError: the program does not copy trackers.
            TrackFault: the process has ended.
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
        """Tell the program to discard the tracker with a protocol number."""
        if self.fault is None:
            self._unsent += message_frame({"type": "end", "id": number})

    def ask(self, numbers: Sequence[int], scans: Sequence[Scan], members: Sequence[int] | None = None) -> list[Any]:
        """Send one scan to each of several trackers; return their answers, whose form is unchecked.

        Args:
            numbers: protocol numbers of the trackers.
            scans: one scan for each tracker.
            members: index of the member of the batch that each tracker follows; None for one tracker of all members.

        Raises:
            TrackFault: a tracker failed; the process has ended, is late, or answered something else.
        """
        frames, answers = scan_frames(numbers, scans), list[Any]()
        chunk = max(1, ON_THE_WAY // max(map(len, frames), default=1))
        for first in range(0, len(frames), chunk):
            self.send(*frames[first : first + chunk])
            for number in numbers[first : first + chunk]:
                try:
                    answers.append(self._answer(number))
                except (TrackFault, TrackerFault) as error:
                    fault = fault_of(error)
                    fault.member = fault.member if members is None else members[len(answers)]
                    raise fault from error
        return answers

    def __deepcopy__(self, memo: object) -> Program:
        # The process is shared; each of its trackers is copied by itself.
        return self

    def _answer(self, number: int) -> Any:
        answer = self.receive()
        kind = answer.get("type")
        if kind not in ("estimate", "none", "tracks") or answer.get("id") != number:
            request = f"a scan of tracker {number}"
            raise self.failed(f"it answered {request} with {_text(kind)} of {_text(answer.get('id'))}")
        return message_answer(answer, self._several)

    def _understand(self, answer: Mapping[str, Any]) -> None:
        version = answer.get("version")
        if answer.get("type") != "hello" or type(version) is not int:
            raise self.failed(f"it answered hello with {_text(answer.get('type'))}; hello with a version is needed")
        if version != VERSION:
            raise self.failed(f"it speaks version {version} of the protocol, and this trackbench {VERSION}")
        self.batched, self.random, self.copies, self.confirms = (
            answer.get(name) is True for name in ("batched", "random", "copies", "confirms")
        )


class ProgramTracker:
    """Tracker in the process of a program, which also keeps the tracker's state."""

    def __init__(self, program: Program, number: int | None = None) -> None:
        self.program, self.number = program, program.start() if number is None else number
        self.batched, self.random = program.batched, program.random

    def step(self, state: str | None, scan: Scan) -> tuple[str, Any]:
        """Return a placeholder for the state, which the program keeps, and the tracker's answer."""
        return KEPT_THERE, self.program.ask([self.number], [scan])[0]

    def __deepcopy__(self, memo: object) -> ProgramTracker:
        return ProgramTracker(self.program, self.program.copy(self.number))

    def __del__(self) -> None:
        self.program.end(self.number)


def host_command(reference: str, folder: Path | None = None) -> tuple[list[str], str]:
    """Return the command that serves a Python tracker, and its working directory.

    Args:
        reference: ``module:Class`` or a published name.
        folder: first folder in which the tracker's module is looked for.
    """
    working_folder = "."
    # The folder may have been deleted.
    with suppress(FileNotFoundError):
        working_folder = os.getcwd()
    return [*HOST, reference, *([] if folder is None else ["--folder", str(folder)])], working_folder


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


def _text(value: Any) -> str:
    return shortened_text(repr(value), SHOWN)

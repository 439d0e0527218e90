"""A program that follows objects, as the bench speaks to it: one in another language, or the host of one in Python."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from trackbench.base import notebook_classes
from trackbench.base.errors import InputError, shortened_text
from trackbench.base.types import Scan
from trackbench.driving.child import SHOWN, ChildProcess
from trackbench.driving.frames import VERSION, ScanFrames, id_of, message_frame, packed_array
from trackbench.driving.isolation import Isolation, lacking
from trackbench.driving.processes import HOST, Launch
from trackbench.models.sensors import Sensor
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.foreign import Command


class Program(ChildProcess):
    """A program that serves trackers, each with a number.

    Args:
        config: names it, or a class of Python.
        folder: where its path starts, and where it runs; of a class where its module is looked for first.
        isolation: the longest that it may take to answer, and the most memory.
        several: whether it is to follow several objects.
        batch: how many members the bench follows at once.
        sensors: of the scenario, by name.
        mode: how a class of Python is served, as of ``host.MODES``.

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
        mode: str = "batch",
    ) -> None:
        if missing := lacking():
            raise InputError(f"programs cannot be started: {platform.system()} has no {missing}")
        hello = _hello(config, several, batch, sensors)
        super().__init__(isolation, _launch(config, folder, mode), _name(config))
        self.members = batch
        self.not_copied: str | None = None
        """Why a tracker in it is repeated on the same scans instead of being copied; None while none was."""
        self._unsent += hello
        self._numbers = 0
        try:
            self.send()
            self._understand(self.receive())
        except BaseException:
            self.close()
            raise

    def start(self) -> int:
        """The number of a fresh tracker."""
        self._numbers += 1
        self._unsent += message_frame({"type": "start", "id": self._numbers})
        return self._numbers

    def copy(self, number: int) -> int:
        """The number of a copy of a tracker, with its state.

        Raises:
            TypeError: the program does not copy trackers.
        """
        if not self.copies:
            raise TypeError("its program does not say that it copies trackers")
        self._numbers += 1
        self._unsent += message_frame({"type": "copy", "id": self._numbers, "of": number})
        return self._numbers

    def end(self, number: int) -> None:
        """A tracker is no longer needed."""
        if self.fault is None:
            self._unsent += message_frame({"type": "end", "id": number})

    def answer(self, number: int) -> dict[str, Any]:
        """The next answer to a scan, which the tracker of this number was given.

        Raises:
            TrackFault: as of ``receive``.
        """
        answer = self.receive()
        kind = answer.get("type")
        if kind not in ("estimate", "none", "tracks") or answer.get("id") != number:
            asked = f"a scan of tracker {number}"
            raise self.failed(f"it answered {asked} with {_said(kind)} of {_said(answer.get('id'))}")
        if "not_copied" in answer:
            self.not_copied = str(answer["not_copied"])
        return answer

    def ask(self, number: int, scan: Scan) -> dict[str, Any]:
        """What a tracker answers to a scan."""
        self.send([ScanFrames(scan).of(id_of(number), scan)])
        return self.answer(number)

    def _understand(self, answer: Mapping[str, Any]) -> None:
        version = answer.get("version")
        if answer.get("type") != "hello" or type(version) is not int:
            raise self.failed(f"it answered hello with {_said(answer.get('type'))}, where hello with a version is due")
        if version != VERSION:
            raise self.failed(f"it speaks version {version} of the protocol, and this trackbench {VERSION}")
        self.batched, self.separate, self.random, self.copies = (
            answer.get(name) is True for name in ("batched", "separate", "random", "copies")
        )


def host_launch(*arguments: str) -> Launch:
    """The process of a tracker in Python, as of ``host.main``."""
    here = "."
    # It may have been deleted.
    with suppress(FileNotFoundError):
        here = os.getcwd()
    return Launch([*HOST, *arguments], here, os.pathsep.join(sys.path))


def _launch(config: PluginConfig, folder: Path | None, mode: str) -> Launch:
    if isinstance(config.use, Command):
        command = config.use.resolved(folder)
        return Launch(command, str((folder or Path.cwd()).resolve()), os.environ.get("PYTHONPATH"))
    own = [] if folder is None else ["--folder", str(folder)]
    return host_launch(config.reference, "--mode", mode, *own)


def _name(config: PluginConfig) -> str:
    """The text with which messages about a program begin."""
    return f"{config.use.name}: " if isinstance(config.use, Command) else ""


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

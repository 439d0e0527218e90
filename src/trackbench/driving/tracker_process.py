"""The process of a tracker in Python, as the bench asks it."""

from __future__ import annotations

import os
import pickle
import socket
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from trackbench.base import notebook_classes
from trackbench.base.errors import InputError
from trackbench.base.types import Progress, Scan, no_progress
from trackbench.base.user_code import place_in_dump
from trackbench.driving.faults import TrackFault, raise_reported
from trackbench.driving.frames import FrameReader, NotAFrame, ScanFrames, id_of, message_frame
from trackbench.driving.isolation import Isolation
from trackbench.driving.launch import Launch
from trackbench.driving.processes import GLANCE, ChildProcess

#: Types of an answer.
ANSWERS = ("done", "estimate", "tracks", "none")
NO_ANSWER = "its process sent what is no answer"


class TrackerProcess(ChildProcess):
    """A process in which one tracker of a scenario lives, in Python.

    Args:
        isolation: the longest that it may take to answer, and the most memory.
        name: of the tracker, in messages.
        members: of the batch that it follows.
    """

    def __init__(self, isolation: Isolation, name: str, members: int = 0) -> None:
        self._members = members
        self._is_told = False
        self._progress: Progress = no_progress
        self.dropped: list[int] = []
        """Numbers of trackers in it that are no longer needed."""
        self._dump = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._socket, theirs = socket.socketpair()
        self._reader = FrameReader()
        with theirs:
            files = (self._socket, self._dump)
            super().__init__(isolation, Launch(name), (theirs.fileno(), self._dump.fileno()), files)

    def work(self, function: str, arguments: Mapping[str, Any], progress: Progress) -> Any:
        """What a function of the bench returns that is called in the process: a tracker there is looked into.

        Args:
            function: ``module:name``. It tells of its progress, each time within the longest time of an answer.
            arguments: of text and numbers.
            progress: is told of it.

        Raises:
            InputError, TrackFault: as of ``ask``.
        """
        self._progress = progress
        try:
            return pickle.loads(self.ask("work", function=function, arguments=arguments)["returned"])
        except (InputError, TrackFault):
            raise
        except Exception:
            raise self._ended(NO_ANSWER) from None

    def ask(self, kind: str, **request: Any) -> dict[str, Any]:
        """Return what the process answers to a request.

        Raises:
            InputError: the tracker cannot be found or does not take its options.
            TrackFault: it failed, or its process has ended; then it is no longer asked.
        """
        request["type"] = kind
        if not self._is_told:
            request |= {"cwd": None, "path": sys.path, "classes": notebook_classes.dumps(None)}
            # It may have been deleted.
            with suppress(FileNotFoundError):
                request["cwd"] = os.getcwd()
        try:
            content = message_frame(request)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"its process cannot be told this: {error}") from None
        self._is_told = True
        return self._exchange(content)

    def step(self, number: int, scan: Scan) -> dict[str, Any]:
        """Return what a tracker answers to a scan.

        Raises:
            TrackFault: as of ``ask``.
        """
        return self._exchange(ScanFrames(scan).of(id_of(number), scan))

    def _exchange(self, content: bytes) -> dict[str, Any]:
        if self.fault is not None:
            raise self.fault
        self._until = time.monotonic() + self.timeout
        ended = [message_frame({"type": "end", "id": number}) for number in self.dropped]
        self.dropped = []
        try:
            if self.is_too_large:
                raise EOFError
            self._socket.settimeout(self.timeout)
            self._socket.sendall(b"".join((*ended, content)))
            answer = self._reader.receive(self._receive)
            while answer.get("type") == "progress":
                done, expected = float(answer["done"]), float(answer["expected"])
                self._until = time.monotonic() + self.timeout
                self._progress(done, expected)
                answer = self._reader.receive(self._receive)
            if answer.get("type") == "error":
                raise_reported(answer, self._members)
            if answer.get("type") not in ANSWERS:
                raise NotAFrame(NO_ANSWER)
            return answer
        except TimeoutError:
            text = f"it gave no answer within {self.timeout:g} s (see --tracker-timeout)"
            self._abort()
            raise self._ended(text) from None
        except (EOFError, OSError):
            raise self._ended(self._how_it_ended()) from None
        except (NotAFrame, AttributeError, KeyError, TypeError, ValueError):
            raise self._ended(NO_ANSWER) from None

    def start(self, do: str, **request: Any) -> tuple[int, dict[str, Any]]:
        """The number of what a request starts, and what it says of itself.

        Raises:
            InputError: the tracker cannot be found or does not take its options.
            TrackFault: it failed.
        """
        values = self.ask(do, **request)
        try:
            return int(values["number"]), values
        except (KeyError, TypeError, ValueError):
            raise self._ended(NO_ANSWER) from None

    def _receive(self, size: int) -> bytes:
        """Return what comes next, until the answer is overdue or the process has ended: its children may live on."""
        while True:
            left = self._until - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._socket.settimeout(min(left, GLANCE))
            try:
                return self._socket.recv(size)
            except TimeoutError:
                if self.has_ended or self.is_too_large:
                    raise EOFError from None

    def _ended(self, cause: str) -> TrackFault:
        self._dump.seek(0)
        place = place_in_dump(self._dump.read().decode(errors="replace"))
        self._end()
        self.fault = TrackFault(cause, "died", place)
        return self.fault

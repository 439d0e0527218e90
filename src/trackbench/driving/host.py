"""The process in which a tracker lives. It is given scans and gives estimates; there is no truth in it."""

from __future__ import annotations

import copy
import faulthandler
import io
import os
import pickle
import socket
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from trackbench.base import notebook_classes
from trackbench.base.types import Progress
from trackbench.driving.alone import Alone
from trackbench.driving.faults import error_message, fault_of
from trackbench.driving.frames import FrameReader, answer_frame, message_frame, message_scan, with_arrays
from trackbench.driving.printed import say_stray_errors
from trackbench.driving.steppers import Stepper, local, refuse_truth
from trackbench.trackers.answers import is_random
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.published import check_tracker_options, create

#: The keys of a request that are no arguments of its method.
PROCESS_KEYS = ("type", "path", "cwd", "classes")


class Host:
    """Answers the requests of the bench, each named after a method."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._stepped: dict[int, Alone | Stepper] = {}
        self._numbers = 0

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return what the method that a request names answers."""
        arguments = {key: with_arrays(value) for key, value in request.items() if key not in PROCESS_KEYS}
        if "path" in request:
            sys.path[:] = request["path"]
            notebook_classes.loads(request["classes"])
            with suppress(OSError):
                os.chdir(request["cwd"] or ".")
        answer: dict[str, Any] = getattr(self, request["type"])(**arguments)
        return {"type": "done", **answer}

    def step(self, message: dict[str, Any]) -> bytes:
        """Return the frame that answers a scan."""
        number = message["id"]
        return answer_frame(number, self._stepped[number].step(message_scan(message)))

    def end(self, number: int) -> None:
        """Forget a tracker."""
        self._stepped.pop(number, None)

    def check(self, config: dict[str, Any], folder: str) -> dict[str, Any]:
        """Import the tracker and hold its options against what it declares."""
        own = PluginConfig.model_validate(config)
        check_tracker_options(own.reference, own.options, _folder(folder))
        return {}

    def start(self, config: dict[str, Any], folder: str, batch: int, several: bool) -> dict[str, Any]:
        """A fresh tracker for a batch, whose answers are checked."""
        known = PluginConfig.model_validate(config)
        stepper = local(known, _folder(folder), batch, lambda tracker: tracker, several)
        return {"number": self._keep(stepper), **stepper.traits._asdict()}

    def fresh(self, config: dict[str, Any], folder: str) -> dict[str, Any]:
        """A fresh tracker as it is."""
        own = PluginConfig.model_validate(config)
        alone = Alone(create(own.reference, own.options, _folder(folder)))
        if isinstance(alone.tracker, FilterTracker):
            refuse_truth(alone.tracker)
        number = self._keep(alone)
        return {"number": number, **self.traits(number)}

    def traits(self, number: int) -> dict[str, Any]:
        """What a tracker can do, and why it cannot be copied, where that has been tried."""
        alone = self._alone(number)
        tracker = alone.tracker
        methods = [name for name in dir(type(tracker)) if not name.startswith("_") and callable(getattr(tracker, name))]
        traits = {"batched": alone.batched, "random": is_random(tracker), "methods": methods}
        return {**traits, "not_copied": alone.not_copied}

    def copy(self, number: int) -> dict[str, Any]:
        """An independent copy of a tracker and its state, or why there is none of one that follows a batch."""
        stepped = self._stepped[number]
        if isinstance(stepped, Alone):
            return {"number": self._keep(stepped.copy())}
        try:
            return {"number": self._keep(copy.deepcopy(stepped))}
        except Exception as error:
            return {"number": 0, "not_copied": fault_of(error).cause}

    def call(self, number: int, method: str, arguments: tuple[Any, ...]) -> dict[str, Any]:
        """What a method of a tracker returns, an array."""
        return {"returned": np.array(getattr(self._alone(number).tracker, method)(*arguments), dtype=float)}

    def work(self, function: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """What a function of the bench returns, ``module:name``, which tells of its progress and is called here."""
        module, _, name = function.partition(":")
        returned = getattr(import_module(module), name)(**arguments, progress=self._progress)
        return {"returned": pickle.dumps(returned)}

    def _alone(self, number: int) -> Alone:
        stepped = self._stepped[number]
        assert isinstance(stepped, Alone)
        return stepped

    def _keep(self, stepped: Alone | Stepper) -> int:
        self._numbers += 1
        self._stepped[self._numbers] = stepped
        return self._numbers


def _folder(path: str) -> Path | None:
    return Path(path) if path else None


def serve_bench(connection: socket.socket, dump: int, name: str) -> NoReturn:
    """Answer the bench until it ends.

    Args:
        connection: to the bench.
        dump: file descriptor to which the traceback goes when the process is killed by a fault.
        name: of the tracker.
    """
    _prepare(dump)
    say_stray_errors(name)
    own = os.getpid()

    def send(content: bytes) -> None:
        if os.getpid() != own:
            # A copy of this process, which a tracker forked, does not answer.
            os._exit(1)
        connection.sendall(content)

    reader = FrameReader()
    host = Host(lambda done, expected: send(message_frame({"type": "progress", "done": done, "expected": expected})))
    while True:
        try:
            request = reader.receive(connection.recv)
        except (EOFError, OSError):
            os._exit(0)
        except BaseException:
            # What it takes to understand a request, or to answer one, is broken by the tracker.
            os._exit(1)
        try:
            if request["type"] == "end":
                host.end(request["id"])
                continue
            answer = host.step(request) if request["type"] == "scan" else message_frame(host.answer(request))
        except BaseException as error:
            answer = message_frame(error_message(error))
        try:
            send(answer)
        except OSError:
            os._exit(0)


def _prepare(dump: int) -> None:
    file = os.fdopen(dump, "w")
    faulthandler.enable(file)
    leave = os._exit

    def exiting(status: int) -> None:
        faulthandler.dump_traceback(file)
        leave(status)

    # Where a tracker leaves by this way is worth knowing.
    os._exit = exiting  # type: ignore[assignment]

    if isinstance(sys.stdout, io.TextIOWrapper):
        # What a tracker printed before its process is killed is seen.
        sys.stdout.reconfigure(line_buffering=True)

"""Program that serves a Python tracker by the protocol of docs/any-language.md; it holds no ground truth.

Run as ``python -m trackbench.driving.host MODULE:CLASS``.
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import io
import os
import pickle
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from trackbench.base import notebook_classes
from trackbench.base.errors import TrackbenchError
from trackbench.driving.faults import error_message
from trackbench.driving.frames import VERSION, answer_frame, is_plain, message_frame, message_scan, read_message
from trackbench.driving.steppers import refuse_truth
from trackbench.trackers.answers import TRACKS, checked_tracks, is_random, shaped_estimate, unpack
from trackbench.trackers.published import check_tracker_options, create

#: Abilities announced in the greeting: the host copies trackers, and confirms each copy.
COPIES = {"copies": True, "confirms": True}


class Host:
    """Server of a Python tracker, which answers the messages of the bench.

    Args:
        reference: ``module:Class`` or a published name.
        folder: first folder in which the tracker's module is looked for.
        send: function that writes a frame (packed message) to the bench.
    """

    def __init__(self, reference: str, folder: Path | None, send: Callable[[bytes], None]) -> None:
        self._reference, self._folder, self._send = reference, folder, send
        self._several = False
        self._make: Callable[[], Any]
        self._spare: list[Any] = []
        self._trackers: dict[int, tuple[Any, Any]] = {}

    def answer(self, message: Mapping[str, Any]) -> bytes | None:
        """Handle a message of the bench; return the answer as a frame (packed message), or None if none is needed."""
        match message["type"]:
            case "scan":
                return self._step(message)
            case "hello":
                return self._greet(message)
            case "start":
                # A start has no answer that could report a failure: the tracker is made at its first scan.
                self._trackers[message["id"]] = self._spare.pop() if self._spare else None, None
            case "copy":
                self._trackers[message["id"]] = _copied(*self._trackers[message["of"]])
                return message_frame({"type": "done"})
            case "end":
                self._trackers.pop(message["id"], None)
            case "work":
                return self._work(message)
        return None

    def _step(self, message: Mapping[str, Any]) -> bytes:
        number, scan = message["id"], message_scan(message)
        tracker, state = self._trackers[number]
        if tracker is None:
            tracker = self._make()
        state, answer = unpack(tracker.step(state, scan), TRACKS if self._several else "estimate")
        self._trackers[number] = tracker, state
        if self._several:
            return answer_frame(number, checked_tracks(answer, scan))
        return answer_frame(number, answer if is_plain(answer) else shaped_estimate(answer, scan))

    def _greet(self, hello: Mapping[str, Any]) -> bytes:
        self._several = hello["identities"] == "hidden"
        if "classes" in hello:
            notebook_classes.loads(hello["classes"])
        greeting: dict[str, Any] = {"type": "hello", "version": VERSION, "name": self._reference, **COPIES}
        if not hello["batch"]:
            check_tracker_options(self._reference, hello["options"], self._folder)
            return message_frame(greeting)
        self._make = create(self._reference, dict(hello["options"]), self._folder)
        tracker = self._make()
        refuse_truth(tracker)
        self._spare = [tracker]
        greeting |= {"batched": bool(getattr(tracker, "batched", False)), "random": is_random(tracker)}
        return message_frame(greeting)

    def _work(self, message: Mapping[str, Any]) -> bytes:
        """Call a function of the bench, ``module:name``, that examines the tracker; report its progress."""
        notebook_classes.loads(message["classes"])
        module, _, name = message["function"].partition(":")

        def progress(done: float, expected: float) -> None:
            self._send(message_frame({"type": "progress", "done": done, "expected": expected}))

        returned = getattr(import_module(module), name)(**message["arguments"], progress=progress)
        return message_frame({"type": "returned", "pickled": pickle.dumps(returned)})


def _copied(tracker: Any, state: Any) -> tuple[Any, Any]:
    if hasattr(tracker, "__del__") and not hasattr(tracker, "__deepcopy__"):
        raise TrackbenchError("it has a destructor, which the end of a copy would call")
    return copy.deepcopy((tracker, state))


def serve_tracker(arguments: Sequence[str]) -> NoReturn:
    """Serve a tracker on standard input and output until the input ends."""
    parser = argparse.ArgumentParser(prog="python -m trackbench.driving.host", description=__doc__)
    parser.add_argument("tracker", help="module:Class, or a published name")
    parser.add_argument("--folder", type=Path, help="where its module is looked for first")
    options = parser.parse_args(arguments)
    requests, answers, process, leave = os.fdopen(os.dup(0), "rb"), os.dup(1), os.getpid(), os._exit
    _give_streams(answers)

    def send(frame: bytes) -> None:
        if os.getpid() != process:
            # A fork of this process, made by the tracker, must not answer.
            leave(1)
        rest = memoryview(frame)
        while rest:
            rest = rest[os.write(answers, rest) :]

    host = Host(options.tracker, options.folder, send)
    try:
        while True:
            message = read_message(requests.read)
            try:
                answer = host.answer(message)
            except BaseException as error:
                answer = message_frame(error_message(error))
            if answer is not None:
                send(answer)
    except (EOFError, OSError):
        leave(0)
    finally:
        # The tracker has damaged the means to read a request.
        os._exit(1)


def _give_streams(answers: int) -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Flush each line, so that output before a kill is not lost.
        sys.stdout.reconfigure(line_buffering=True)
    process, leave = os.getpid(), os._exit

    def exiting(status: int) -> None:
        if os.getpid() == process:
            faulthandler.dump_traceback(answers)
        leave(status)

    faulthandler.enable(answers)
    os._exit = exiting  # type: ignore[assignment]
    os.register_at_fork(after_in_child=faulthandler.disable)


if __name__ == "__main__":
    serve_tracker(sys.argv[1:])

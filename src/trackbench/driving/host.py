"""The program that serves a tracker in Python, by the protocol of docs/any-language.md; there is no truth in it.

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
from trackbench.driving.faults import error_message
from trackbench.driving.frames import VERSION, answer_frame, message_frame, message_scan, read_message
from trackbench.driving.steppers import Stateful, Stepper, local, refuse_truth
from trackbench.trackers.answers import is_random, shaped_estimate
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.published import check_tracker_options, create

#: How the trackers are served: for all members of a batch, their answers checked; each as it is; not at all, when the
#: class is only looked for.
MODES = BATCH, EACH, CHECK = ("batch", "each", "check")

#: What the host says of copies: there are some, and it answers whether one was made.
COPIES = {"copies": True, "confirms": True}
#: A tracker as it is served: as it is, or for a batch.
Tracker = Stateful[Any] | Stepper


class Host:
    """Answers the messages of the bench.

    Args:
        reference: of the tracker, ``module:Class`` or a published name.
        folder: where its module is looked for first.
        mode: how it is served, one of ``MODES``.
        send: writes a frame.
    """

    def __init__(self, reference: str, folder: Path | None, mode: str, send: Callable[[bytes], None]) -> None:
        self._reference, self._folder, self._mode, self._send = reference, folder, mode, send
        self._hello: Mapping[str, Any] = {}
        self._unused: Tracker | None = None
        self._trackers: dict[int, Tracker | BaseException] = {}

    def answer(self, message: Mapping[str, Any]) -> bytes | None:
        """Do what a message asks for, and return the frame of the answer; None where none is due."""
        match message["type"]:
            case "scan":
                return self._step(message["id"], message)
            case "hello":
                return self._greet(message)
            case "start":
                self._trackers[message["id"]] = self._started()
            case "copy":
                self._trackers[message["id"]] = _copied(self._trackers[message["of"]])
                return message_frame({"type": "done"})
            case "end":
                self._trackers.pop(message["id"], None)
            case "work":
                return self._work(message)
        return None

    def _step(self, number: int, message: Mapping[str, Any]) -> bytes:
        tracker = self._trackers[number]
        if isinstance(tracker, BaseException):
            raise tracker
        return answer_frame(number, tracker.step(message_scan(message)))

    def _greet(self, hello: Mapping[str, Any]) -> bytes:
        self._hello = hello
        if "classes" in hello:
            notebook_classes.loads(hello["classes"])
        check_tracker_options(self._reference, hello["options"], self._folder)
        answer: dict[str, Any] = {"type": "hello", "version": VERSION, "name": self._reference, **COPIES}
        if self._mode == CHECK:
            return message_frame(answer)
        tracker = self._unused = self._made()
        if isinstance(tracker, Stepper):
            traits = {"batched": True, "separate": not tracker.traits.batched, "random": tracker.traits.random}
        else:
            traits = {"batched": tracker.batched, "random": is_random(tracker.tracker)}
        return message_frame(answer | traits)

    def _made(self) -> Tracker:
        options = dict(self._hello["options"])
        if self._mode == EACH:
            tracker = create(self._reference, options, self._folder)()
            if isinstance(tracker, FilterTracker):
                refuse_truth(tracker)
            return Stateful(tracker, shaped_estimate)
        config = PluginConfig(use=self._reference, options=options)
        several = self._hello["identities"] == "hidden"
        return local(config, self._folder, self._hello["batch"], lambda tracker: tracker, several)

    def _started(self) -> Tracker | BaseException:
        tracker, self._unused = self._unused, None
        try:
            return tracker or self._made()
        except BaseException as error:
            # It is raised when the tracker is given a scan: this message has no answer.
            return error

    def _work(self, message: Mapping[str, Any]) -> bytes:
        """Call a function of the bench, ``module:name``, that looks into a tracker and tells of its progress."""
        notebook_classes.loads(message["classes"])
        module, _, name = message["function"].partition(":")

        def progress(done: float, expected: float) -> None:
            self._send(message_frame({"type": "progress", "done": done, "expected": expected}))

        returned = getattr(import_module(module), name)(**message["arguments"], progress=progress)
        return message_frame({"type": "returned", "pickled": pickle.dumps(returned)})


def _copied(tracker: Tracker | BaseException) -> Tracker | BaseException:
    return tracker.copied() if isinstance(tracker, Stateful) else copy.deepcopy(tracker)


def serve_tracker(arguments: Sequence[str]) -> NoReturn:
    """Serve a tracker on standard input and output, until the input ends."""
    parser = argparse.ArgumentParser(prog="python -m trackbench.driving.host", description=__doc__)
    parser.add_argument("tracker", help="module:Class, or a published name")
    parser.add_argument("--folder", type=Path, help="where its module is looked for first")
    parser.add_argument("--mode", choices=MODES, default=BATCH, help="how it is served")
    options = parser.parse_args(arguments)
    requests, answers, own, leave = os.fdopen(os.dup(0), "rb"), os.dup(1), os.getpid(), os._exit
    _give_streams(answers)

    def send(frame: bytes) -> None:
        if os.getpid() != own:
            # A copy of this process, which a tracker forked, does not answer.
            leave(1)
        rest = memoryview(frame)
        while rest:
            rest = rest[os.write(answers, rest) :]

    host = Host(options.tracker, options.folder, options.mode, send)
    while True:
        try:
            message = read_message(requests.read)
        except (EOFError, OSError):
            leave(0)
        except BaseException:
            # What it takes to understand a request is broken by the tracker.
            os._exit(1)
        try:
            answer = host.answer(message)
        except BaseException as error:
            answer = message_frame(error_message(error))
        if answer is None:
            continue
        try:
            send(answer)
        except OSError:
            leave(0)


def _give_streams(answers: int) -> None:
    """Give the tracker streams of its own, and write where it was to ``answers`` where it ends the process."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # What a tracker printed before its process is killed is seen.
        sys.stdout.reconfigure(line_buffering=True)
    own, leave = os.getpid(), os._exit

    def exiting(status: int) -> None:
        if os.getpid() == own:
            faulthandler.dump_traceback(answers)
        leave(status)

    faulthandler.enable(answers)
    os._exit = exiting  # type: ignore[assignment]
    os.register_at_fork(after_in_child=faulthandler.disable)


if __name__ == "__main__":
    serve_tracker(sys.argv[1:])

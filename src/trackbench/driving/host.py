"""The process in which a tracker lives. It is given scans and gives estimates; there is no truth in it."""

from __future__ import annotations

import copy
import faulthandler
import io
import os
import pickle
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from trackbench.base import at_hand
from trackbench.base.errors import InputError, InputErrors
from trackbench.base.types import Estimate, FieldOfView, Progress, Scan, Tracks
from trackbench.driving.alone import Alone
from trackbench.driving.faults import fault_of
from trackbench.driving.printed import say_stray_errors
from trackbench.driving.steppers import Stepper, local, refuse_truth
from trackbench.driving.wire import Arrays, receive_message, send_answer
from trackbench.trackers.answers import is_random
from trackbench.trackers.config import PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.published import check_tracker_options, create

#: The keys of a request that are no arguments of its method.
PROCESS_KEYS = ("do", "exchange", "drop", "path", "cwd", "classes")


class Host:
    """Answers the requests of the bench, each named after a method."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._stepped: dict[int, Alone | Stepper] = {}
        self._numbers = 0

    def answer(self, request: dict[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """The answer to a request."""
        arguments = {key: value for key, value in request.items() if key not in PROCESS_KEYS}
        if "path" in request:
            sys.path[:] = request["path"]
            at_hand.receive_classes(request["classes"])
            with suppress(OSError):
                os.chdir(request["cwd"] or ".")
        for number in request["drop"]:
            self._stepped.pop(number, None)
        answer: tuple[dict[str, Any], Arrays] = getattr(self, request["do"])(**arguments)
        return answer

    def check(self, config: dict[str, Any], folder: str) -> tuple[dict[str, Any], Arrays]:
        """Import the tracker and hold its options against what it declares."""
        own = PluginConfig.model_validate(config)
        check_tracker_options(own.reference, own.options, _folder(folder))
        return {}, {}

    def start(self, config: dict[str, Any], folder: str, batch: int, several: bool) -> tuple[dict[str, Any], Arrays]:
        """A fresh tracker for a batch, whose answers are checked."""
        known = PluginConfig.model_validate(config)
        stepper = local(known, _folder(folder), batch, lambda tracker: tracker, several)
        return {"number": self._keep(stepper), **stepper.traits._asdict()}, {}

    def fresh(self, config: dict[str, Any], folder: str) -> tuple[dict[str, Any], Arrays]:
        """A fresh tracker as it is."""
        own = PluginConfig.model_validate(config)
        alone = Alone(create(own.reference, own.options, _folder(folder)))
        if isinstance(alone.tracker, FilterTracker):
            refuse_truth(alone.tracker)
        number = self._keep(alone)
        return {"number": number, **self.traits(number)[0]}, {}

    def traits(self, number: int) -> tuple[dict[str, Any], Arrays]:
        """What a tracker can do, and why it cannot be copied, where that has been tried."""
        alone = self._alone(number)
        tracker = alone.tracker
        methods = [name for name in dir(type(tracker)) if not name.startswith("_") and callable(getattr(tracker, name))]
        traits = {"batched": alone.batched, "random": is_random(tracker), "methods": methods}
        return {**traits, "not_copied": alone.not_copied}, {}

    def step(self, number: int, scan: list[Any], copied: bool = False) -> tuple[dict[str, Any], Arrays]:
        """The estimate after a scan, whose fields are given; of a copy, if it is to be copied before."""
        if copied:
            number = self._keep(self._alone(number).copy())
        estimate = self._stepped[number].step(_scan(scan))
        return {"given": estimate is not None, "number": number}, {} if estimate is None else _arrays(estimate)

    def walk(self, number: int, scans: list[list[Any]]) -> tuple[dict[str, Any], Arrays]:
        """The estimates after each of some scans, up to the first step that fails."""
        alone = self._alone(number)
        return _answers(alone.step, scans)

    def peeks(self, number: int, scans: list[list[Any]]) -> tuple[dict[str, Any], Arrays]:
        """The estimate after each of some scans by a copy of its own, up to the first step that fails."""
        alone = self._alone(number)
        return _answers(lambda scan: alone.copy().step(scan), scans)

    def copy(self, number: int) -> tuple[dict[str, Any], Arrays]:
        """An independent copy of a tracker and its state, or why there is none of one that follows a batch."""
        stepped = self._stepped[number]
        if isinstance(stepped, Alone):
            return {"number": self._keep(stepped.copy())}, {}
        try:
            return {"number": self._keep(copy.deepcopy(stepped))}, {}
        except Exception as error:
            return {"number": 0, "not_copied": fault_of(error).cause}, {}

    def call(self, number: int, method: str, arguments: tuple[Any, ...]) -> tuple[dict[str, Any], Arrays]:
        """What a method of a tracker returns, an array."""
        return {}, {"returned": np.array(getattr(self._alone(number).tracker, method)(*arguments), dtype=float)}

    def work(self, function: str, arguments: dict[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """What a function of the bench returns, ``module:name``, which tells of its progress and is called here."""
        module, _, name = function.partition(":")
        returned = getattr(import_module(module), name)(**arguments, progress=self._progress)
        return {"returned": pickle.dumps(returned)}, {}

    def _alone(self, number: int) -> Alone:
        stepped = self._stepped[number]
        assert isinstance(stepped, Alone)
        return stepped

    def _keep(self, stepped: Alone | Stepper) -> int:
        self._numbers += 1
        self._stepped[self._numbers] = stepped
        return self._numbers


def _answers(step: Callable[[Scan], Estimate | None], scans: list[list[Any]]) -> tuple[dict[str, Any], Arrays]:
    estimates: list[Estimate | None] = []
    failed = None
    for scan in scans:
        try:
            estimates.append(step(_scan(scan)))
        except BaseException as error:
            failed = _error_values(error)["fault"]
            break
    there = [estimate for estimate in estimates if estimate is not None]
    arrays = {"mean": [each.mean for each in there], "covariance": [each.covariance for each in there]}
    answer = {"given": [estimate is not None for estimate in estimates], "failed": failed}
    return answer, {name: np.array(values, dtype=float) for name, values in arrays.items()}


def _scan(fields: list[Any]) -> Scan:
    scan = Scan(*fields)
    return scan if scan.field_of_view is None else scan._replace(field_of_view=FieldOfView(*scan.field_of_view))


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
    exchange = None

    def progress(done: float, expected: float) -> None:
        send_answer(connection, {"progress": [done, expected], "exchange": exchange}, {})

    host = Host(progress)
    while True:
        try:
            request = receive_message(connection)
        except (EOFError, OSError):
            os._exit(0)
        except BaseException:
            # What it takes to understand a request, or to answer one, is broken by the tracker.
            os._exit(1)
        exchange = request.get("exchange")
        try:
            values, arrays = host.answer(request)
        except BaseException as error:
            values, arrays = _error_values(error), {}
        try:
            send_answer(connection, {**values, "exchange": exchange}, arrays)
        except OSError:
            os._exit(0)
        except BaseException:
            os._exit(1)


def _error_values(error: BaseException) -> dict[str, Any]:
    if isinstance(error, InputErrors):
        return {"input": [[each.message, each.key] for each in error.errors]}
    if isinstance(error, InputError):
        return {"input": [[error.message, error.key]]}
    fault = fault_of(error)
    return {"fault": [fault.cause, fault.kind, fault.place, fault.member]}


def _arrays(estimate: Estimate | Tracks) -> Arrays:
    if isinstance(estimate, Tracks):
        return {name: np.asarray(value) for name, value in estimate._asdict().items() if value is not None}
    arrays = {"mean": estimate.mean, "covariance": estimate.covariance}
    for name in ("state", "innovation", "innovation_covariance", "repaired", "mode_probabilities"):
        value = getattr(estimate, name)
        if value is None:
            continue
        try:
            arrays[name] = np.array(value, dtype=bool if name == "repaired" else float)
        except (TypeError, ValueError):
            if name != "state":
                raise
            # A state of another form is the tracker's own affair.
    return arrays


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

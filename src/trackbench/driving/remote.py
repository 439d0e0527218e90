"""A tracker wherever it lives: a built-in filter here, any other in a process of its own."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks
from trackbench.driving.faults import TrackFault
from trackbench.driving.frames import message_array, plain_estimate
from trackbench.driving.isolation import Isolation, is_program
from trackbench.driving.program import Program
from trackbench.driving.program_steppers import ProgramStepper, ProgramTracker, answer_of
from trackbench.driving.steppers import ESTIMATE_FORM, TRACKS_FORM, AnswerForm, Prepare, Stepper, Traits, local
from trackbench.driving.tracker_process import NO_ANSWER, TrackerProcess
from trackbench.models.sensors import Sensor
from trackbench.trackers.answers import KEPT_THERE, Tracker, TrackerFault, shaped_estimate
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.published import check_tracker_options, create

#: Of a tracker that is examined as it is.
SHAPED_FORM = ESTIMATE_FORM._replace(check=shaped_estimate)


class TrackerTrial:
    """A tracker of a scenario, tried before it is needed: its module is imported once, in this process or its own."""

    def __init__(self, config: PluginConfig, folder: Path | None, isolation: Isolation) -> None:
        self._config, self._folder, self._isolation = config, folder, isolation
        own = isolation.of(config) and not is_program(config)
        self._process = TrackerProcess(isolation, str(config.use)) if own else None

    def check(self) -> None:
        """Find it and hold its options against what it declares; it is not started.

        Raises:
            InputError: it cannot be found, or the options do not fit.
            TrackFault: its process ended.
        """
        if isinstance(self._config.use, Command):
            self._config.use.resolved(self._folder)
        elif self._process is None:
            check_tracker_options(self._config.reference, self._config.options, self._folder)
        else:
            self._process.ask("check", **_named(self._config, self._folder))

    def start(self, several: bool = False, sensors: Mapping[str, Sensor] = {}) -> None:
        """Start it for one member; what is no class of Python is told the sensors, and of several objects.

        Raises:
            InputError: it does not start.
            TrackFault: its process ended.
        """
        several = several and not isinstance(self._config.use, str)
        if self._process is None:
            start_stepper(
                self._config, self._folder, 1, lambda tracker: tracker, self._isolation, several, sensors
            ).close()
        else:
            RemoteStepper(self._process, self._config, self._folder, 1, several)

    def close(self) -> None:
        """End its process."""
        if self._process is not None:
            self._process.close()


def start_stepper(
    config: FilterConfig | PluginConfig,
    folder: Path | None,
    batch: int,
    prepare: Prepare,
    isolation: Isolation,
    several: bool = False,
    sensors: Mapping[str, Sensor] = {},
) -> Stepper:
    """A fresh tracker for a batch, its answers checked.

    Args:
        config: the scenario's entry.
        folder: where a tracker's module is looked for first.
        batch: how many tracks, or runs, it follows at once.
        prepare: sets the engine of a built-in tracker, and its first states where it starts from the truth.
        isolation: whether it gets a process of its own.
        several: whether it follows several objects.
        sensors: of the scenario, by name, which a program is told.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if not isolation.of(config):
        return local(config, folder, batch, prepare, several)
    assert isinstance(config, PluginConfig)
    if is_program(config):
        return ProgramStepper(Program(config, folder, isolation, several, batch, sensors), batch, several)
    process = TrackerProcess(isolation, str(config.use), batch)
    try:
        return RemoteStepper(process, config, folder, batch, several)
    except BaseException:
        process.close()
        raise


def fresh_tracks(
    config: FilterConfig | PluginConfig, folder: Path | None, isolation: Isolation
) -> Callable[[], Stepper]:
    """A function that gives fresh trackers of several objects, each for one run, one after the other from one process.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    make: Callable[[], Stepper] = partial(local, config, folder, 1, lambda tracker: tracker, several=True)
    if isinstance(config, PluginConfig) and is_program(config):
        make = partial(ProgramStepper, Program(config, folder, isolation, several=True), 1, several=True)
    elif isinstance(config, PluginConfig) and isolation.of(config):
        process = TrackerProcess(isolation, str(config.use), 1)
        make = partial(RemoteStepper, process, config, folder, 1, several=True)
    make()
    return make


def fresh(config: PluginConfig, folder: Path | None, isolation: Isolation) -> Callable[[], Tracker]:
    """A function that gives fresh trackers as they are, one after the other from one process.

    Raises:
        InputError: it cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if is_program(config):
        return partial(ProgramTracker, Program(config, folder, isolation, several=False))
    if not isolation.of(config):
        return create(config.reference, config.options, folder)
    process = TrackerProcess(isolation, str(config.use))
    make = partial(RemoteTracker.fresh, process, config, folder)
    make()
    return make


class RemoteStepper(Stepper):
    """A tracker that follows a batch in a process of its own, which may have others."""

    def __init__(
        self,
        process: TrackerProcess,
        config: FilterConfig | PluginConfig,
        folder: Path | None,
        batch: int,
        several: bool,
    ) -> None:
        self._process, self._form = process, TRACKS_FORM if several else ESTIMATE_FORM
        self._number, traits = process.start("start", **_named(config, folder), batch=batch, several=several)
        self.traits = Traits(bool(traits.get("batched")), bool(traits.get("random")))

    def step(self, scan: Scan, origins: Indices | None = None) -> Any:
        """The answer for all members; their origins are not sent.

        Raises:
            TrackFault: the tracker failed.
        """
        message = self._process.step(self._number, scan)
        if self._form is ESTIMATE_FORM and (estimate := plain_estimate([message], *scan.valid.shape)):
            return estimate
        return _checked(message, scan, self._form)

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def __deepcopy__(self, memo: dict[int, Any]) -> RemoteStepper:
        number, answer = self._process.start("copy", number=self._number)
        if "not_copied" in answer:
            raise TypeError(answer["not_copied"])
        twin = copy.copy(self)
        twin._number = number
        return twin

    def __del__(self) -> None:
        # One that did not start has no number.
        if self._process.fault is None and hasattr(self, "_number"):
            self._process.dropped.append(self._number)


class RemoteTracker:
    """A tracker in a process of its own, which also has its state. A copy of it is one with the state of now."""

    def __init__(
        self, process: TrackerProcess, number: int, batched: bool, random: bool, methods: frozenset[str]
    ) -> None:
        self._process = process
        self._number = number
        self.batched, self.random = batched, random
        self._methods = methods

    @classmethod
    def fresh(cls, process: TrackerProcess, config: PluginConfig, folder: Path | None) -> RemoteTracker:
        """A fresh one."""
        number, traits = process.start("fresh", **_named(config, folder))
        methods = frozenset(map(str, traits.get("methods", ())))
        return cls(process, number, bool(traits.get("batched")), bool(traits.get("random")), methods)

    def step(self, state: str | None, scan: Scan) -> tuple[str, Estimate | None]:
        """What stands for its state, and the estimate."""
        message = self._process.step(self._number, scan)
        return KEPT_THERE, _checked(message, scan, SHAPED_FORM)

    @property
    def not_copied(self) -> str | None:
        """Why its process repeats it on the same scans instead of copying it; None while it has not."""
        reason = self._process.ask("traits", number=self._number).get("not_copied")
        return None if reason is None else str(reason)

    def __deepcopy__(self, memo: dict[int, Any]) -> RemoteTracker:
        number, _ = self._process.start("copy", number=self._number)
        return RemoteTracker(self._process, number, self.batched, self.random, self._methods)

    def __getattr__(self, name: str) -> Callable[..., Array]:
        if name.startswith("_") or name not in self._methods:
            raise AttributeError(name)

        def call(*arguments: Any) -> Array:
            message = self._process.ask("call", number=self._number, method=name, arguments=arguments)
            try:
                return message_array(message, "returned")
            except TrackerFault as error:
                raise TrackFault(NO_ANSWER, "died") from error

        return call

    def __del__(self) -> None:
        if self._process.fault is None:
            self._process.dropped.append(self._number)


def _named(config: FilterConfig | PluginConfig, folder: Path | None) -> dict[str, Any]:
    return {"config": config.model_dump(), "folder": "" if folder is None else str(folder)}


def _checked(message: Mapping[str, Any], scan: Scan, form: AnswerForm) -> Any:
    try:
        return form.check(answer_of(message, form.kind is Tracks), scan)
    except TrackerFault as error:
        # Its process has looked at it before.
        raise TrackFault(NO_ANSWER, "died") from error

"""A tracker wherever it lives: a built-in filter here, any other in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.types import Array, Estimate, Indices, Scan, Tracks
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import Isolation
from trackbench.driving.processes import NO_ANSWER, TrackerProcess
from trackbench.driving.steppers import Stepper, local
from trackbench.driving.tracks import TracksStepper, checked_tracks, local_tracks
from trackbench.engine.choice import Engine
from trackbench.engine.equations import EngineUsed
from trackbench.trackers.answers import Tracker, TrackerFault, shaped
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.published import check_options, create

#: Stands for the state of a tracker that has it in its process.
KEPT_THERE = "kept in the tracker's process"


class TrackerTrial:
    """A tracker of a scenario, tried before it is needed: its module is imported once, in this process or its own."""

    def __init__(self, config: PluginConfig, folder: Path | None, isolation: Isolation) -> None:
        self._config, self._folder = config, folder
        self._process = TrackerProcess(isolation.timeout) if isolation.of(config) else None

    def check(self) -> None:
        """Find it and hold its options against what it declares; it is not started.

        Raises:
            InputError: it cannot be found, or the options do not fit.
            TrackFault: its process ended.
        """
        if self._process is None:
            check_options(self._config.use, self._config.options, self._folder)
        else:
            self._process.ask("check", **_named(self._config, self._folder))

    def start(self) -> None:
        """Start it for one member.

        Raises:
            InputError: it does not start.
            TrackFault: its process ended.
        """
        if self._process is None:
            local(self._config, self._folder, 1, lambda given: given).close()
        else:
            self._process.start("start", config=self._config, folder=self._folder, batch=1)

    def close(self) -> None:
        """End its process."""
        if self._process is not None:
            self._process.close()


def start(
    config: FilterConfig | PluginConfig,
    folder: Path | None,
    batch: int,
    with_initial_states: Callable[[FilterTracker], FilterTracker],
    isolation: Isolation,
) -> Stepper:
    """A fresh tracker for a batch, its answers checked.

    Args:
        config: the scenario's entry.
        folder: where a tracker's module is looked for first.
        batch: how many tracks it follows at once.
        with_initial_states: gives a built-in filter its first states, where it starts from the truth.
        isolation: whether it gets a process of its own.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if not isolation.of(config):
        return local(config, folder, batch, with_initial_states)
    return RemoteStepper(config, folder, batch, isolation.timeout)


def start_tracks(
    config: FilterConfig | PluginConfig, folder: Path | None, runs: int, isolation: Isolation, engine: Engine
) -> TracksStepper:
    """A fresh tracker of several objects for some runs, its answers checked; a built-in one is computed by the engine.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if not isolation.of(config):
        return local_tracks(config, folder, runs, engine)
    return RemoteTracks(config, folder, runs, isolation.timeout)


def fresh_tracks(
    config: FilterConfig | PluginConfig, folder: Path | None, isolation: Isolation
) -> Callable[[], TracksStepper]:
    """A function that gives fresh trackers of several objects, each for one run, one after the other from one process.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    make: Callable[[], TracksStepper] = partial(local_tracks, config, folder, 1)
    if isolation.of(config):
        make = partial(RemoteTracks.fresh, TrackerProcess(isolation.timeout), config, folder)
    make()
    return make


def fresh(use: str, options: dict[str, Any], folder: Path | None, isolation: Isolation) -> Callable[[], Tracker]:
    """A function that gives fresh trackers as they are, one after the other from one process.

    Raises:
        InputError: it cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    config = PluginConfig(use=use, options=options)
    if not isolation.of(config):
        return create(use, options, folder)
    process = TrackerProcess(isolation.timeout)
    make = partial(RemoteTracker.fresh, process, _named(config, folder))
    make()
    return make


class _Remote:
    """A tracker in a process of its own, started by a request."""

    def __init__(self, timeout: float, members: int, do: str, **request: Any) -> None:
        self._process = TrackerProcess(timeout, members)
        try:
            self._number = self._process.start(do, **request)
        except BaseException:
            self.close()
            raise

    @property
    def engine_used(self) -> EngineUsed | None:
        """Only a built-in tracker says what computed it."""
        return None

    def close(self) -> None:
        """End the process."""
        self._process.close()


class RemoteStepper(_Remote):
    """A tracker that follows a batch in a process of its own."""

    def __init__(self, config: FilterConfig | PluginConfig, folder: Path | None, batch: int, timeout: float) -> None:
        super().__init__(timeout, batch, "start", config=config, folder=folder, batch=batch)

    def step(self, scan: Scan) -> Estimate | None:
        """The estimates of all members.

        Raises:
            TrackFault: the tracker failed.
        """
        return _step(self._process, self._number, scan)


class RemoteTracks(_Remote):
    """A tracker of several objects in a process of its own."""

    def __init__(self, config: FilterConfig | PluginConfig, folder: Path | None, runs: int, timeout: float) -> None:
        super().__init__(timeout, runs, "start_tracks", config=config, folder=folder, runs=runs)

    @classmethod
    def fresh(cls, process: TrackerProcess, config: FilterConfig | PluginConfig, folder: Path | None) -> RemoteTracks:
        """A fresh one in a process that has others; not to be closed."""
        made = cls.__new__(cls)
        made._process = process
        made._number = process.start("start_tracks", config=config, folder=folder, runs=1)
        return made

    def step(self, scan: Scan, origins: Indices | None = None) -> Tracks:
        """The tracks of all runs; their origins are not told.

        Raises:
            TrackFault: the tracker failed.
        """
        _, arrays = self._process.ask("step", number=self._number, scan=scan)
        try:
            return checked_tracks(Tracks(**arrays), scan)
        except (TypeError, TrackerFault) as error:
            raise TrackFault(NO_ANSWER, "died") from error


class RemoteTracker:
    """A tracker in a process of its own, which also has its state. A copy of it is one with the state of now."""

    def __init__(
        self, process: TrackerProcess, number: int, batched: bool, stochastic: bool, methods: frozenset[str]
    ) -> None:
        self._process = process
        self._number = number
        self.batched, self.stochastic = batched, stochastic
        self._methods = methods

    @classmethod
    def fresh(cls, process: TrackerProcess, named: dict[str, Any]) -> RemoteTracker:
        """A fresh one."""
        number = process.start("fresh", **named)
        about, _ = process.ask("about", number=number)
        said = bool(about.get("batched")), bool(about.get("stochastic"))
        return cls(process, number, *said, frozenset(map(str, about.get("methods", ()))))

    def step(self, state: str | None, scan: Scan) -> tuple[str, Estimate | None]:
        """What stands for its state, and the estimate."""
        return KEPT_THERE, _step(self._process, self._number, scan)

    @property
    def not_copied(self) -> str | None:
        """Why its process repeats it on the same scans instead of copying it; None while it has not."""
        said = self._process.ask("about", number=self._number)[0].get("not_copied")
        return None if said is None else str(said)

    def __deepcopy__(self, memo: dict[int, Any]) -> RemoteTracker:
        number = self._process.start("copy", number=self._number)
        return RemoteTracker(self._process, number, self.batched, self.stochastic, self._methods)

    def __getattr__(self, name: str) -> Callable[..., Array]:
        if name.startswith("_") or name not in self._methods:
            raise AttributeError(name)

        def call(*arguments: Any) -> Array:
            _, arrays = self._process.ask("call", number=self._number, method=name, arguments=arguments)
            return arrays.get("returned", np.full(0, np.nan))

        return call

    def __del__(self) -> None:
        if self._process.fault is None:
            self._process.dropped.append(self._number)


def _named(config: PluginConfig, folder: Path | None) -> dict[str, Any]:
    return {"use": config.use, "options": config.options, "folder": folder}


def _step(process: TrackerProcess, number: int, scan: Scan) -> Estimate | None:
    answer, arrays = process.ask("step", number=number, scan=scan)
    if not answer.get("given"):
        return None
    try:
        return shaped(Estimate(**arrays), scan)
    except (TypeError, TrackerFault) as error:
        # Its process has looked at it before.
        raise TrackFault(NO_ANSWER, "died") from error

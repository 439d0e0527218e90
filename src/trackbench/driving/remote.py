"""A tracker wherever it lives: a built-in filter here, any other in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from trackbench.driving.isolation import Isolation
from trackbench.driving.program import Program
from trackbench.driving.program_steppers import ProgramStepper, ProgramTracker
from trackbench.driving.steppers import Prepare, Stepper, local
from trackbench.models.sensors import Sensor
from trackbench.trackers.answers import Tracker
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.published import check_tracker_options, create


def check_startable(
    config: PluginConfig,
    folder: Path | None,
    isolation: Isolation,
    started: bool,
    several: bool,
    sensors: Mapping[str, Sensor],
) -> None:
    """Find a tracker and hold its options against what it declares, in the process where it will live.

    Args:
        config: the scenario's entry.
        folder: where a tracker's module is looked for first.
        isolation: whether it gets a process of its own.
        started: whether it is started for one member, too.
        several: whether it follows several objects.
        sensors: of the scenario, by name.

    Raises:
        InputError: it cannot be found, the options do not fit, or it does not start.
        TrackFault: its process ended.
    """
    if isinstance(config.use, Command):
        config.use.resolved(folder)
    elif not isolation.of(config):
        check_tracker_options(config.reference, config.options, folder)
    elif not started:
        Program(config, folder, isolation, several, mode="check").close()
    if started:
        start_stepper(config, folder, 1, lambda tracker: tracker, isolation, several, sensors).close()


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
    return ProgramStepper(Program(config, folder, isolation, several, batch, sensors), batch, several)


def fresh_tracks(
    config: FilterConfig | PluginConfig, folder: Path | None, isolation: Isolation
) -> Callable[[], Stepper]:
    """A function that gives fresh trackers of several objects, each for one run, one after the other from one process.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if isinstance(config, PluginConfig) and isolation.of(config):
        return partial(ProgramStepper, Program(config, folder, isolation, several=True), 1, several=True)
    make = partial(local, config, folder, 1, lambda tracker: tracker, several=True)
    make()
    return make


def fresh(config: PluginConfig, folder: Path | None, isolation: Isolation) -> Callable[[], Tracker]:
    """A function that gives fresh trackers as they are, one after the other from one process.

    Raises:
        InputError: it cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if not isolation.of(config):
        return create(config.reference, config.options, folder)
    return partial(ProgramTracker, Program(config, folder, isolation, several=False, mode="each"))

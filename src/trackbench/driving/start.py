"""Start of the trackers of a scenario: built-in ones here, others here or in a process of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError
from trackbench.driving.isolation import Isolation
from trackbench.driving.program import Program, ProgramTracker
from trackbench.driving.steppers import ForeignTracker, refuse_truth
from trackbench.models.sensors import Sensor
from trackbench.trackers.answers import Tracker
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import Command
from trackbench.trackers.late import LateScans
from trackbench.trackers.multi import build_multi
from trackbench.trackers.published import check_tracker_options, create

#: Function that sets the engine and the first states of a built-in tracker.
Prepare = Callable[[Any], Any]


def fresh(
    config: PluginConfig,
    folder: Path | None,
    isolation: Isolation,
    several: bool = False,
    batch: int = 1,
    sensors: Mapping[str, Sensor] = {},
) -> Callable[[], Tracker]:
    """Return a function that makes fresh trackers that are not built in, all in one process.

    Args:
        config: the tracker's settings in the scenario.
        folder: first folder in which the tracker's module is looked for.
        isolation: whether the trackers get a process of their own.
        several: whether a tracker follows several objects.
        batch: number of tracks, or runs, followed at once; passed on to a program.
        sensors: sensors of the scenario by name; passed on to a program.

    Raises:
        InputError: the tracker cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if isolation.of(config):
        return partial(ProgramTracker, Program(config, folder, isolation, several, batch, sensors))
    return create(config.reference, config.options, folder)


def fresh_tracks(config: FilterConfig | PluginConfig, folder: Path | None, isolation: Isolation) -> Callable[[], Any]:
    """Return a function that makes fresh multi-object trackers, each for one run, all in one process.

    Raises:
        InputError: a plug-in cannot be found or does not take its options.
        TrackFault: its process ended.
    """
    if isinstance(config, FilterConfig):
        return partial(build_multi, config)
    return partial(ForeignTracker, fresh(config, folder, isolation, several=True), 1, several=True)


def start_stepper(
    config: FilterConfig | PluginConfig,
    folder: Path | None,
    batch: int,
    prepare: Prepare,
    isolation: Isolation,
    several: bool = False,
    sensors: Mapping[str, Sensor] = {},
) -> Any:
    """Return a fresh tracker for a batch: a built-in tracker, or else a :class:`ForeignTracker`.

    Args:
        config: the tracker's settings in the scenario.
        folder: first folder in which a tracker's module is looked for.
        batch: number of tracks, or runs, followed at once.
        prepare: function that sets a built-in tracker's engine, and its first states if it starts from the truth.
        isolation: whether a tracker that is not built in gets a process of its own.
        several: whether the tracker follows several objects.
        sensors: sensors of the scenario by name; passed on to a program.

    Raises:
        InputError: a plug-in cannot be found or does not take its options, or the tracker is a smoother.
        TrackFault: its process ended.
    """
    if isinstance(config, PluginConfig):
        make = fresh(config, folder, isolation, several, batch, sensors)
        if isolation.of(config) or several or not isinstance(tracker := make(), LateScans):
            return ForeignTracker(make, batch, several)
        refuse_truth(tracker)
        return prepare(tracker.reading_only(config.sensors))
    if config.smoother is not None:
        raise InputError("a smoother needs all measurements of a run; remove it", key="smoother")
    return prepare(build_multi(config) if several else build(config))


@contextmanager
def ending(stepper: Any) -> Iterator[Any]:
    """Provide a tracker for a context, and end its process, if it has one, on leaving the context."""
    try:
        yield stepper
    finally:
        if isinstance(stepper, ForeignTracker):
            stepper.close()


def check_startable(
    config: PluginConfig,
    folder: Path | None,
    isolation: Isolation,
    started: bool,
    several: bool,
    sensors: Mapping[str, Sensor],
) -> None:
    """Check that a tracker exists and takes its options, in the process where it will run.

    Args:
        config: the tracker's settings in the scenario.
        folder: first folder in which the tracker's module is looked for.
        isolation: whether the tracker gets a process of its own.
        started: whether to start the tracker for one member as well.
        several: whether the tracker follows several objects.
        sensors: sensors of the scenario by name.

    Raises:
        InputError: the tracker cannot be found, does not take the options, or does not start.
        TrackFault: its process ended.
    """
    if isinstance(config.use, Command):
        config.use.resolved(folder)
    elif not isolation.of(config):
        check_tracker_options(config.reference, config.options, folder)
    elif not started:
        Program(config, folder, isolation, several, batch=0).close()
    if started:
        with ending(start_stepper(config, folder, 1, lambda tracker: tracker, isolation, several, sensors)):
            pass

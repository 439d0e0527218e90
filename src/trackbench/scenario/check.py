"""The checks of a scenario that need highway-env, a recording or the code of a plug-in."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from trackbench import plugins
from trackbench.errors import InputError, InputErrors
from trackbench.scenario.load import LoadedScenario
from trackbench.trackers.config import PluginConfig
from trackbench.truth import validate

Step = Callable[[], None]


def check(loaded: LoadedScenario) -> None:
    """Set the environment up or read the recording, and start each plug-in once, without running anything.

    Raises:
        InputError: everything that highway-env or the plug-ins do not accept, with file and line, or that is wrong in
            the recording.
    """
    config, folder = loaded.config, loaded.path.resolve().parent
    kinds = {name: sensor.type for name, sensor in config.sensors.items()}
    _all(loaded, [partial(validate, config.truth, folder=folder, sensors=kinds), *_starts(loaded)])


def check_plugins(loaded: LoadedScenario) -> None:
    """Start each plug-in once.

    Raises:
        InputError: every one that cannot be found or does not take its options, with file and line.
    """
    _all(loaded, _starts(loaded))


def _all(loaded: LoadedScenario, steps: Iterable[Step]) -> None:
    errors: list[InputError] = []
    for step in steps:
        try:
            step()
        except InputError as error:
            errors.append(loaded.locate(error))
    if errors:
        raise errors[0] if len(errors) == 1 else InputErrors(errors)


def _starts(loaded: LoadedScenario) -> list[Step]:
    folder = loaded.path.resolve().parent
    return [
        partial(_start, name, tracker, folder)
        for name, tracker in loaded.config.trackers.items()
        if isinstance(tracker, PluginConfig)
    ]


def _start(name: str, tracker: PluginConfig, folder: Path) -> None:
    try:
        plugins.create(tracker.use, tracker.options, folder)
    except InputError as error:
        raise InputError(error.message, key=error.key or f"trackers.{name}.use") from error

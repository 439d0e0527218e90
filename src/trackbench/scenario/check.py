"""Checks of a scenario that need highway-env, a recording or the code of a plug-in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from trackbench.base.errors import InputError, InputErrors
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import ISOLATED, Isolation, is_program
from trackbench.scenario.load import Scenario
from trackbench.scenario.truth import own_source, require_rates
from trackbench.trackers.config import PluginConfig
from trackbench.truth.config.traffic import TracksConfig, read_tracks

Step = Callable[[], object]


def check(loaded: Scenario, isolation: Isolation = ISOLATED) -> list[str]:
    """Check the truth's environment or recording, and the options of each plug-in; no plug-in is started.

    Returns:
        Notes, one per line, on the rows of a recording that are used or left out.

    Raises:
        InputError: highway-env or a plug-in does not accept an option, or the recording is wrong; with every fault,
            its file and line.
    """
    notes: list[str] = []

    def check_truth() -> None:
        notes.extend(own_source(loaded).check(folder=loaded.folder, sensors=loaded.config.sensor_kinds) or ())
        require_rates(loaded)

    _run_all(loaded, [check_truth, *_tracker_checks(loaded, isolation, started=False)])
    return notes


def check_plugins(loaded: Scenario, isolation: Isolation = ISOLATED) -> None:
    """Start each plug-in once, before a run, to find the ones that fail.

    Raises:
        InputError: a plug-in cannot be found or does not take its options; with every such plug-in, file and line.
    """
    _run_all(loaded, list(_tracker_checks(loaded, isolation, started=True)))


def _run_all(loaded: Scenario, steps: list[Step]) -> None:
    errors: list[InputError] = []
    for step in steps:
        try:
            step()
        except InputError as error:
            located = loaded.locate(error)
            errors += located.errors if isinstance(located, InputErrors) else [located]
    if errors:
        raise errors[0] if len(errors) == 1 else InputErrors(errors)


def _tracker_checks(loaded: Scenario, isolation: Isolation, *, started: bool) -> Iterator[Step]:
    for name, tracker in loaded.config.trackers.items():
        if isinstance(tracker, TracksConfig):
            yield partial(read_tracks, tracker, name, loaded.folder)
        if isinstance(tracker, PluginConfig):
            yield partial(_check_startable, loaded, name, tracker, isolation, started)


def _check_startable(loaded: Scenario, name: str, tracker: PluginConfig, isolation: Isolation, started: bool) -> None:
    # Imported here: slow to import, and few scenarios have a plug-in.
    from trackbench.driving.start import check_startable

    several = loaded.config.sensing.identities == "hidden"
    try:
        check_startable(tracker, loaded.folder, isolation, started, several, loaded.config.sensors)
    except InputError as error:
        parts = error.errors if isinstance(error, InputErrors) else [error]
        raise InputErrors([_with_key(part, name) for part in parts]) from error
    except TrackFault as fault:
        # A program that does not start fails in the result, while the other trackers run.
        if not is_program(tracker):
            verb = "start" if started else "look at"
            raise InputError(f"cannot {verb} {str(tracker.use)!r}: {fault}", key=f"trackers.{name}.use") from fault


def _with_key(error: InputError, name: str) -> InputError:
    key = f"trackers.{name}.use" if error.key is None else f"trackers.{name}.options.{error.key}"
    return InputError(error.message, key=key)

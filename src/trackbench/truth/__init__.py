"""Ground truth, from whatever source a scenario names: simulated (once, and kept), scripted, or recorded.

The simulator takes a second to import, so nothing here imports it before it is needed.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from trackbench.truth import cache as store
from trackbench.truth import scripted
from trackbench.truth.config import AnyTruth, HighwayTruth, RecordingTruth, ScriptedTruth
from trackbench.types import Progress, RecordedMeasurements, Truth, no_progress

__all__ = ["Draw", "LoadedTruth", "list_envs", "load_truth", "most_runs", "validate", "varies"]

OWN_CLASSES = "highway_env."

log = logging.getLogger(__name__)


class Draw(NamedTuple):
    """What random motion is drawn by: ``streams.stream(seed, scenario, run, "motion of <object>")``."""

    seed: int
    scenario: str
    runs: int


class LoadedTruth(NamedTuple):
    """A truth and how it was come by."""

    truth: Truth
    cached: bool
    """Whether it was read from the cache."""
    notes: tuple[str, ...] = ()
    """What went wrong with the cache, a line each."""
    measurements: dict[str, RecordedMeasurements] | None = None
    """By sensor; None where measurements are to be synthesised."""


def load_truth(
    config: AnyTruth,
    draw: Draw,
    *,
    folder: Path,
    sensors: Mapping[str, str] | None = None,
    cache: bool = True,
    progress: Progress = no_progress,
) -> LoadedTruth:
    """The truth that ``config`` describes.

    Args:
        config: the ``truth`` of a scenario.
        draw: what random motion is drawn by.
        folder: the scenario's, where relative paths start.
        sensors: the kind of each of the scenario's sensors, which a recording may feed.
        cache: whether a simulated truth is read from the cache and kept there.
        progress: called with the number of steps simulated and of all.

    Raises:
        InputError: the configuration cannot be simulated, the audit is told to refuse and finds a fault, or a
            recording is missing or damaged.
    """
    match config:
        case HighwayTruth():
            return _simulated(config, cache, progress)
        case ScriptedTruth():
            return LoadedTruth(scripted.script(config, *draw), cached=False)
        case RecordingTruth():
            from trackbench.truth import recorded

            recording = recorded.load(config, sensors or {}, folder)
            return LoadedTruth(recording.truth, cached=False, measurements=recording.measurements)


def validate(config: AnyTruth, *, folder: Path | None = None, sensors: Mapping[str, str] | None = None) -> None:
    """Check everything that can be checked without simulating; a recording is read.

    Args:
        config: the ``truth`` of a scenario.
        folder: the scenario's, where relative paths start; the working directory unless given.
        sensors: the kind of each of the scenario's sensors, which a recording may feed.

    Raises:
        InputError: an unknown environment or key, a value of the wrong type, rates that do not divide, a recording
            that is missing or damaged.
    """
    if isinstance(config, HighwayTruth):
        from trackbench.truth import highway

        highway.validate(config)
    if isinstance(config, RecordingTruth):
        from trackbench.truth import recorded

        recorded.load(config, sensors or {}, folder or Path())


def varies(config: AnyTruth) -> bool:
    """Whether the motion differs from run to run."""
    return isinstance(config, ScriptedTruth) and config.random


def most_runs(config: AnyTruth) -> int | None:
    """The number of runs whose motion fits the memory; None where it does not depend on them."""
    return scripted.most_runs(config) if isinstance(config, ScriptedTruth) and config.random else None


def list_envs() -> list[str]:
    """The environments that a scenario can name."""
    from trackbench.truth import highway

    return highway.list_envs()


def _simulated(config: HighwayTruth, cache: bool, progress: Progress) -> LoadedTruth:
    """From the cache if it is there."""
    file = store.path(config) if cache and _determined(config) else None
    notes = []
    if file is not None:
        try:
            stored = store.read(file, config)
        except ValueError as error:
            notes.append(f"cache: {error}; simulated again")
        else:
            if stored is not None:
                log.info("truth from the cache: %s", file)
                return LoadedTruth(stored, cached=True)

    from trackbench.truth import highway

    begin = time.perf_counter()
    truth = highway.simulate(config, progress)
    log.info("truth simulated in %.1f s: %s", time.perf_counter() - begin, config.env)
    if file is not None:
        try:
            store.write(file, config, truth)
            log.info("truth kept in the cache: %s", file)
        except OSError as error:
            notes.append(f"cache: {file.parent} cannot be written ({error.strerror}); the truth is not kept")
    return LoadedTruth(truth, cached=False, notes=tuple(notes))


def _determined(config: HighwayTruth) -> bool:
    """Whether the configuration and the versions determine the truth: a user's own driver class may change."""
    vehicles = config.config.get("other_vehicles_type", OWN_CLASSES)
    return str(vehicles).startswith(OWN_CLASSES)

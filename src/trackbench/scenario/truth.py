"""The truth that a scenario is about, of each of its scenes."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from trackbench.errors import InputError, TrackbenchError
from trackbench.interruption import allow_termination, uninterrupted
from trackbench.scenario.load import Scenario
from trackbench.truth import Draw, LoadedTruth, TruthSource
from trackbench.types import Progress, no_progress

DIED = "a process that simulated a scene died; --workers 1 may show what it died of"


def truth_of(loaded: Scenario, progress: Progress = no_progress) -> LoadedTruth:
    """As ``truths_of``, of the first scene alone."""
    load = _Load.of(loaded)
    try:
        return load(loaded.config.truth, progress)
    except InputError as error:
        raise loaded.locate(error) from None


def truths_of(loaded: Scenario, progress: Progress = no_progress, workers: int = 1) -> list[LoadedTruth]:
    """Simulate, draw or read the truth of each scene, in their order.

    The same to the last bit for any number of workers.

    Args:
        loaded: the scenario.
        progress: called with the number of steps simulated and of all; with several processes, scene by scene.
        workers: number of processes. A scene that is stored needs none.

    Raises:
        InputError: one cannot be had; with file and line.
        TrackbenchError: a process died.
    """
    scenes = loaded.config.truth.scenes()
    load = _Load.of(loaded)
    found = [scene.stored() for scene in scenes]
    missing = [number for number, truth in enumerate(found) if truth is None]
    sources = [scenes[number] for number in missing]
    several = min(workers, len(sources))
    made = _in_processes(load, sources, progress, several) if several > 1 else _one_by_one(load, sources, progress)
    for number in missing:
        try:
            found[number] = next(made)
        except InputError as error:
            if len(scenes) > 1:
                error = InputError(f"scene {number + 1} of {len(scenes)}: {error.message}", key=error.key)
            raise loaded.locate(error) from None
    return [truth for truth in found if truth is not None]


@dataclass(frozen=True)
class _Load:
    """Loads the truth of one source."""

    draw: Draw
    folder: Path
    kinds: dict[str, str]

    @classmethod
    def of(cls, loaded: Scenario) -> _Load:
        config = loaded.config
        draw = Draw(config.monte_carlo.seed, config.name, config.monte_carlo.runs)
        kinds = {name: sensor.type for name, sensor in config.sensors.items()}
        return cls(draw, loaded.path.resolve().parent, kinds)

    def __call__(self, source: TruthSource, progress: Progress = no_progress) -> LoadedTruth:
        return source.load(self.draw, folder=self.folder, sensors=self.kinds, progress=progress)


def _one_by_one(load: _Load, sources: Sequence[TruthSource], progress: Progress) -> Iterator[LoadedTruth]:
    for number, source in enumerate(sources):

        def advance(done: float, total: float, before: int = number) -> None:
            progress(before * total + done, len(sources) * total)

        yield load(source, advance)


def _in_processes(
    load: _Load, sources: Sequence[TruthSource], progress: Progress, workers: int
) -> Iterator[LoadedTruth]:
    others = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin, (load.folder,))
    try:
        with uninterrupted():
            futures = [executor.submit(load, source) for source in sources]
        for done, future in enumerate(futures, 1):
            truth = future.result()
            steps = len(truth.truth.time)
            progress(done * steps, len(sources) * steps)
            yield truth
    except BaseException as error:
        # Nobody waits for the scenes that are still simulated.
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        if isinstance(error, BrokenProcessPool):
            raise TrackbenchError(DIED) from error
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def _begin(folder: Path) -> None:
    """In a new process: a source may be a class of the user's own, from a module beside the scenario."""
    allow_termination()
    sys.path[:0] = [str(folder), str(Path.cwd())]
    # What a source prints is no part of the result.
    sys.stdout = sys.stderr

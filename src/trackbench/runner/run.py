"""Run a scenario: make its blocks of runs by an executor, and assemble the result."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import counted
from trackbench.base.execution import Executor
from trackbench.base.types import Progress, Scan, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.results import Failure, Result
from trackbench.results.columns import table_of
from trackbench.runner.assemble import assemble
from trackbench.runner.block import Block, failures_and_outcomes
from trackbench.runner.loop import run_blocks
from trackbench.runner.recorded import OnRecordedRun, RecordedInstant
from trackbench.runner.work import BlockRuns, Work, work_of
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.truth import LoadedTruth

if TYPE_CHECKING:
    import pyarrow as pa

log = logging.getLogger(__name__)


def run_scenario(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    *,
    executor: Executor | None = None,
    isolation: Isolation = ISOLATED,
    engine: EngineName = "auto",
    command: str = "",
    keeps_answers: bool = False,
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> Result:
    """Run all trackers of a scenario in all Monte-Carlo runs; return metrics, comparisons and tables as the result.

    With one engine the result is the same on any executor, to the last bit, but for the measured times.

    Args:
        loaded: the scenario.
        truths: truth of each scene.
        executor: makes the blocks of runs; this process unless given.
        isolation: limits of the processes in which plug-ins run.
        engine: engine that computes built-in trackers and scores.
        command: command line that reproduces the result.
        keeps_answers: whether the result has the table ``answers``, with the trackers' answers in every run; the engine
            is NumPy then.
        progress: called with the number of finished runs and the number of all runs.
        on_recorded_run: called with the recorded run (kept for plots) while that run is made; should return at once.

    Raises:
        InputError: the engine is not available.
        TrackbenchError: the processes that make the runs died.
    """
    options: Any = {"observed": on_recorded_run is not None, "keeps_answers": keeps_answers}
    pending = PendingRun(loaded, truths, executor or Executor(), isolation, engine, **options)
    return pending.collect(lambda _: command, progress, on_recorded_run)


def answers_of_scenes(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    scenes: Collection[int],
    executor: Executor,
    isolation: Isolation = ISOLATED,
) -> pa.Table | Failure:
    """Run only the given scenes; return the trackers' estimates or tracks as a table, or a tracker's first failure.

    Args:
        loaded: the scenario.
        truths: truth of each of its scenes.
        scenes: numbers of the scenes that are run.
        executor: makes the blocks of runs.
        isolation: limits of the processes in which plug-ins run.
    """
    pending = PendingRun(loaded, truths, executor, isolation, keeps_answers=True, scenes=scenes)
    blocks = pending.blocks()
    failures, _ = failures_and_outcomes(loaded.config.trackers, blocks)
    for failure in failures.values():
        return failure
    return table_of([record for block in blocks for record in block.answers])


class PendingRun:
    """Run of a scenario that starts at once, by an executor; ``collect`` waits for the result.

    Args:
        loaded: the scenario.
        truths: truth of each scene.
        executor: makes the blocks of runs.
        isolation: limits of the processes in which plug-ins run.
        engine: engine that computes built-in trackers and scores.
        observed: whether ``collect`` gets a function that receives the recorded run (the run that is kept for plots).
        alone: whether no other scenario is run at the same time.
        keeps_answers: whether the result has the table ``answers``; the engine is NumPy then.
        scenes: numbers of the scenes that are run; None for all.
    """

    def __init__(
        self,
        loaded: Scenario,
        truths: Sequence[LoadedTruth],
        executor: Executor,
        isolation: Isolation = ISOLATED,
        engine: EngineName = "auto",
        *,
        observed: bool = False,
        alone: bool = True,
        keeps_answers: bool = False,
        scenes: Collection[int] | None = None,
    ) -> None:
        self._loaded, self._truths, self._begin = loaded, truths, time.perf_counter()
        options: Any = {"observed": observed, "alone": alone, "keeps_answers": keeps_answers, "scenes": scenes}
        self._by_numpy = partial(PendingRun, loaded, truths, executor, isolation, "numpy", **options)
        work = work_of(loaded, truths, isolation, "numpy" if keeps_answers else engine)
        self._work = replace(work, keeps_answers=keeps_answers)
        pieces = [piece for piece in work.pieces() if scenes is None or piece.scene in scenes]
        self._done, self._total = 0, sum(len(piece.runs) for piece in pieces)
        self._progress: Progress = no_progress
        self._on_recorded_run: OnRecordedRun | None = None
        self._groups = work.groups(pieces)
        of_scenes = cache(self._work.of_scenes)
        local_calls: list[tuple[Work, list[BlockRuns]]] = []
        executor_calls: list[tuple[Work, list[BlockRuns]]] = []
        self._is_local = []
        for group in self._groups:
            call = of_scenes(tuple(dict.fromkeys(piece.scene for piece in group))), group
            is_observed = observed and any(work.recorded_in(piece) is not None for piece in group)
            is_local = is_observed or (alone and len(self._groups) == 1)
            self._is_local.append(is_local)
            (local_calls if is_local else executor_calls).append(call)
        observers = self._advance, self._observe if observed else None
        self._from_here = Executor().map(run_blocks, local_calls, observers=observers)
        self._from_executor = executor.map(run_blocks, executor_calls, own_folder(loaded), observers)

    def collect(
        self,
        command: Callable[[Scenario], str],
        progress: Progress = no_progress,
        on_recorded_run: OnRecordedRun | None = None,
    ) -> Result:
        """Wait for all runs and return the result.

        Args:
            command: returns the command line that reproduces the result of a scenario.
            progress: called with the number of finished runs and the number of all runs.
            on_recorded_run: called with the recorded run (kept for plots) while that run is made, if ``observed``.

        Raises:
            TrackbenchError: the processes that make the blocks died.
        """
        blocks = self.blocks(progress, on_recorded_run)
        _log_times(self._work, blocks, time.perf_counter() - self._begin)
        return assemble(self._loaded, self._truths, self._work, blocks, command(self._loaded))

    def blocks(self, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None) -> list[Block]:
        """Wait for the blocks and return them in order; repeat all by NumPy if a user's kernel differs from NumPy."""
        self._progress, self._on_recorded_run = progress, on_recorded_run
        blocks: list[Block] = []
        for group, is_local in zip(self._groups, self._is_local, strict=True):
            blocks += next(self._from_here if is_local else self._from_executor)
            self._done += sum(len(piece.runs) for piece in group)
            self._progress(self._done, self._total)
        blocks.sort(key=lambda block: (block.piece.scene, block.piece.runs.start))
        if any(used.differs for block in blocks for used in block.engines.values()):
            engines = [block.engines for block in blocks]
            # Blocks of many runs are large: free them first.
            blocks.clear()
            blocks = self._by_numpy().blocks(progress, on_recorded_run)
            for block, before in zip(blocks, engines, strict=True):
                reasons = {name: used._replace(engine="numpy", again=0, differs=False) for name, used in before.items()}
                block.engines |= reasons
        return blocks

    def _advance(self, done: float, _: float) -> None:
        self._progress(self._done + done, self._total)

    def _observe(self, part: list[Scan] | RecordedInstant) -> None:
        if self._on_recorded_run is not None:
            self._on_recorded_run(part)


def _log_times(work: Work, blocks: list[Block], seconds: float) -> None:
    runs = counted(work.runs * len(work.scenes), "run")
    log.info("%s: %s in %.1f s, %s", work.scenario, runs, seconds, counted(len(blocks), "block"))
    for name, outcomes in failures_and_outcomes(work.trackers, blocks)[1].items():
        log.info("%s: %s took %.2f s", work.scenario, name, sum(outcome.seconds for outcome in outcomes))

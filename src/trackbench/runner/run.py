"""Run a scenario: its blocks of runs through the executor, and the result of them all."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

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
    """The result of a scenario.

    That of an engine is the same wherever it is made, to the last bit, but for the times.

    Args:
        loaded: the scenario.
        truths: those of its scenes.
        executor: what makes the blocks of runs; this process unless given.
        isolation: how trackers that are not built in are kept apart.
        engine: what computes.
        command: what reproduces the result.
        keeps_answers: whether the result has the table ``answers``, of all that the trackers say in every run; NumPy
            computes then.
        progress: called with the number of runs done and of all.
        on_recorded_run: called with the recorded run while it is made; it should return at once.

    Raises:
        InputError: the engine cannot be had.
        TrackbenchError: the processes that make the runs died.
    """
    options = {"observed": on_recorded_run is not None, "keeps_answers": keeps_answers}
    pending = PendingRun(loaded, truths, executor or Executor(), isolation, engine, **options)
    return pending.collect(lambda _: command, progress, on_recorded_run)


def answers_of_scenes(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    scenes: Collection[int],
    executor: Executor,
    isolation: Isolation = ISOLATED,
) -> pa.Table | Failure:
    """Return the table ``answers`` of some scenes alone; the failure where a tracker cannot go on.

    Args:
        loaded: the scenario.
        truths: those of all its scenes.
        scenes: the numbers of those that are run.
        executor: what makes the blocks of runs.
        isolation: how trackers that are not built in are kept apart.
    """
    work = replace(work_of(loaded, truths, isolation), keeps_answers=True)
    pieces = [piece for piece in work.pieces() if piece.scene in scenes]
    blocks = PendingBlocks(loaded, work, pieces, executor).collect()
    failures, _ = failures_and_outcomes(work.trackers, blocks)
    for failure in failures.values():
        return failure
    return table_of([record for block in blocks for record in block.answers])


class PendingRun:
    """The runs of a scenario, being made.

    Args:
        loaded: the scenario.
        truths: those of its scenes.
        executor: what makes the blocks of runs.
        isolation: how trackers that are not built in are kept apart.
        engine: what computes.
        observed: whether the recorded run is looked at.
        alone: whether no other scenario is run at the same time.
        keeps_answers: as of ``run_scenario``.
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
    ) -> None:
        self._loaded, self._truths = loaded, truths
        work = work_of(loaded, truths, isolation, "numpy" if keeps_answers else engine)
        self._work = replace(work, keeps_answers=keeps_answers)
        self._begin = time.perf_counter()
        self._blocks = PendingBlocks(loaded, self._work, self._work.pieces(), executor, observed=observed, alone=alone)

    def collect(
        self,
        command: Callable[[Scenario], str],
        progress: Progress = no_progress,
        on_recorded_run: OnRecordedRun | None = None,
    ) -> Result:
        """The result, once all runs are done; as ``run_scenario``.

        Args:
            command: gives what reproduces the result of a scenario.
            progress: called with the number of runs done and of all.
            on_recorded_run: called with the recorded run while it is made.
        """
        blocks = self._blocks.collect(progress, on_recorded_run)
        _log_times(self._work, blocks, time.perf_counter() - self._begin)
        return assemble(self._loaded, self._truths, self._work, blocks, command(self._loaded))


class PendingBlocks:
    """The blocks of a run, being made.

    Args:
        loaded: the scenario.
        work: what is the same for all of them.
        pieces: which blocks.
        executor: what makes them.
        observed: whether the recorded run is looked at, so that its block has to be made in this process.
        alone: whether nothing else is made at the same time, so that a single block is no work for another process.
    """

    def __init__(
        self,
        loaded: Scenario,
        work: Work,
        pieces: Sequence[BlockRuns],
        executor: Executor,
        *,
        observed: bool = False,
        alone: bool = True,
    ) -> None:
        options = {"observed": observed, "alone": alone}
        self._by_numpy = partial(PendingBlocks, loaded, replace(work, engine="numpy"), pieces, executor, **options)
        self._done, self._total = 0, sum(len(piece.runs) for piece in pieces)
        self._progress: Progress = no_progress
        self._on_recorded_run: OnRecordedRun | None = None
        self._groups = work.groups(pieces)
        of_scenes = cache(work.of_scenes)
        here: list[tuple[Work, list[BlockRuns]]] = []
        there: list[tuple[Work, list[BlockRuns]]] = []
        self._is_here = []
        for group in self._groups:
            call = of_scenes(tuple(dict.fromkeys(piece.scene for piece in group))), group
            is_here = (alone and len(self._groups) == 1) or (observed and any(map(work.has_recorded_run, group)))
            self._is_here.append(is_here)
            (here if is_here else there).append(call)
        observers = self._advance, self._observe if observed else None
        self._here = Executor().map(run_blocks, here, observers=observers)
        self._there = executor.map(run_blocks, there, own_folder(loaded), observers)

    def collect(self, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None) -> list[Block]:
        """The blocks in their order; all of them by NumPy where a kernel of a user's model differs from NumPy.

        Args:
            progress: called with the number of runs done and of all.
            on_recorded_run: called with the recorded run as it is made, where it is observed.

        Raises:
            TrackbenchError: the processes that make them died.
        """
        self._progress, self._on_recorded_run = progress, on_recorded_run
        blocks: list[Block] = []
        for group, is_here in zip(self._groups, self._is_here, strict=True):
            blocks += next(self._here if is_here else self._there)
            self._done += sum(len(piece.runs) for piece in group)
            self._progress(self._done, self._total)
        blocks.sort(key=lambda block: (block.piece.scene, block.piece.runs.start))
        if any(used.differs for block in blocks for used in block.engines.values()):
            engines = [block.engines for block in blocks]
            # Blocks of many runs are large.
            blocks.clear()
            blocks = self._by_numpy().collect(progress, on_recorded_run)
            for block, before in zip(blocks, engines, strict=True):
                reasons = {name: used._replace(engine="numpy", again=0, differs=False) for name, used in before.items()}
                block.engines |= reasons
        return blocks

    def _advance(self, done: float, _: float) -> None:
        self._progress(self._done + done, self._total)

    def _observe(self, seen: list[Scan] | RecordedInstant) -> None:
        if self._on_recorded_run is not None:
            self._on_recorded_run(seen)


def _log_times(work: Work, blocks: list[Block], seconds: float) -> None:
    runs = counted(work.runs * len(work.scenes), "run")
    log.info("%s: %s in %.1f s, %s", work.scenario, runs, seconds, counted(len(blocks), "block"))
    for name, outcomes in failures_and_outcomes(work.trackers, blocks)[1].items():
        log.info("%s: %s took %.2f s", work.scenario, name, sum(outcome.seconds for outcome in outcomes))

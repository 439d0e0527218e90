"""Run a scenario: truth, measurements, trackers, scores, verdicts."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor

from trackbench.base.errors import counted
from trackbench.base.execution import InProcess
from trackbench.base.types import Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.results import Result
from trackbench.runner.assemble import assemble
from trackbench.runner.block import Block, OnRecordedRun, PendingBlocks, failures_and_outcomes
from trackbench.runner.work import Work, work_of
from trackbench.scenario import Scenario
from trackbench.truth import LoadedTruth

log = logging.getLogger(__name__)


def run_scenario(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    *,
    executor: Executor | None = None,
    isolation: Isolation = ISOLATED,
    engine: EngineName = "auto",
    command: str = "",
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
        progress: called with the number of runs done and of all.
        on_recorded_run: called with the recorded run while it is made; it should return at once.

    Raises:
        InputError: the engine cannot be had.
        TrackbenchError: the processes that make the runs died.
    """
    pending = PendingRun(
        loaded,
        truths,
        executor or InProcess(),
        isolation=isolation,
        engine=engine,
        observed=on_recorded_run is not None,
    )
    return pending.collect(command, progress, on_recorded_run)


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
    """

    def __init__(
        self,
        loaded: Scenario,
        truths: Sequence[LoadedTruth],
        executor: Executor,
        *,
        isolation: Isolation = ISOLATED,
        engine: EngineName = "auto",
        observed: bool = False,
        alone: bool = True,
    ) -> None:
        self._loaded, self._truths = loaded, truths
        self._work = work_of(loaded, truths, isolation, engine)
        self._begin = time.perf_counter()
        self._blocks = PendingBlocks(loaded, self._work, self._work.pieces(), executor, observed=observed, alone=alone)

    def collect(
        self, command: str = "", progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
    ) -> Result:
        """The result, once all runs are done; as ``run_scenario``."""
        blocks = self._blocks.collect(progress, on_recorded_run)
        _log_times(self._work, blocks, time.perf_counter() - self._begin)
        for name, lines in sum((block.unshown for block in blocks), Counter[str]()).items():
            log.warning("%s printed %s more, which were not shown", name, counted(lines, "line"))
        return assemble(self._loaded, self._truths, self._work, blocks, command)


def _log_times(work: Work, blocks: list[Block], seconds: float) -> None:
    runs = counted(work.runs * len(work.scenes), "run")
    log.info("%s: %s in %.1f s, %s", work.scenario, runs, seconds, counted(len(blocks), "block"))
    for name, outcomes in failures_and_outcomes(work.trackers, blocks)[1].items():
        log.info("%s: %s took %.2f s", work.scenario, name, sum(outcome.seconds for outcome in outcomes))

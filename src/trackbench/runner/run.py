"""Run a scenario: truth, measurements, trackers, scores, verdicts."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence

from trackbench.results import Failure, Result
from trackbench.runner.assemble import assemble
from trackbench.runner.block import Block, OnRecordedRun
from trackbench.runner.pool import run_blocks
from trackbench.runner.work import Work, work_of
from trackbench.scenario import Scenario
from trackbench.truth import LoadedTruth
from trackbench.types import Progress, no_progress
from trackbench.words import counted

log = logging.getLogger(__name__)


def run(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    *,
    workers: int = 1,
    command: str = "",
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> Result:
    """The result of a scenario.

    The same for any number of workers, to the last bit, but for the times.

    Args:
        loaded: the scenario.
        truths: those of its scenes.
        workers: number of processes.
        command: what reproduces the result.
        progress: called with the number of runs done and of all.
        on_recorded_run: called with the recorded run while it is made; it should return at once.
    """
    work = work_of(loaded, truths)
    begin = time.perf_counter()
    blocks = list(run_blocks(work, work.pieces(), workers, progress, on_recorded_run))
    _log_times(work, blocks, min(workers, len(blocks)), time.perf_counter() - begin)
    return assemble(loaded, truths, work, blocks, command)


def _log_times(work: Work, blocks: list[Block], processes: int, seconds: float) -> None:
    shared = f"{counted(len(blocks), 'block')} by {processes} process{'es' * (processes > 1)}"
    log.info("%s: %s in %.1f s, %s", work.scenario, counted(work.runs * len(work.scenes), "run"), seconds, shared)
    spent = {name: [block.scores[name] for block in blocks] for name in work.trackers}
    for name, outcomes in spent.items():
        scores = [outcome for outcome in outcomes if not isinstance(outcome, Failure)]
        if len(scores) == len(blocks):
            log.info("%s: %s took %.2f s", work.scenario, name, sum(score.seconds for score in scores))

"""Run a scenario: truth, measurements, trackers, scores, verdicts."""

from __future__ import annotations

import logging
import time

from trackbench.metrics import BUILT_IN
from trackbench.results import Failure, Result
from trackbench.runner.assemble import assemble
from trackbench.runner.block import Block, OnRecordedRun, Work
from trackbench.runner.pool import run_blocks
from trackbench.scenario import Scenario
from trackbench.sensing.scans import ideal_sensors
from trackbench.truth import LoadedTruth
from trackbench.types import Progress, no_progress
from trackbench.words import counted

log = logging.getLogger(__name__)


def run(
    loaded: Scenario,
    truth: LoadedTruth,
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
        truth: its truth.
        workers: number of processes.
        command: what reproduces the result.
        progress: called with the number of runs done and of all.
        on_recorded_run: called with the recorded run while it is made; it should return at once.
    """
    work = work_of(loaded, truth)
    begin = time.perf_counter()
    blocks = list(run_blocks(work, workers, progress, on_recorded_run))
    _log_times(work, blocks, min(workers, len(blocks)), time.perf_counter() - begin)
    return assemble(loaded, truth, work, blocks, command)


def work_of(loaded: Scenario, truth: LoadedTruth) -> Work:
    """What every block of a run of the scenario needs."""
    scenario = loaded.config
    return Work(
        scenario=scenario.name,
        seed=scenario.monte_carlo.seed,
        runs=scenario.monte_carlo.runs,
        truth=truth.truth,
        sensors=ideal_sensors(truth.truth, scenario.sensors, truth.measurements),
        trackers=scenario.trackers,
        folder=loaded.path.resolve().parent,
        settle=scenario.score.settle_s,
        divergence=scenario.score.divergence_m,
        recorded_run=scenario.recording.run,
        metrics=(*BUILT_IN, *scenario.score.metrics),
    )


def _log_times(work: Work, blocks: list[Block], processes: int, seconds: float) -> None:
    shared = f"{counted(len(blocks), 'block')} by {processes} process{'es' * (processes > 1)}"
    log.info("%s: %s in %.1f s, %s", work.scenario, counted(work.runs, "run"), seconds, shared)
    spent = {name: [block.scores[name] for block in blocks] for name in work.trackers}
    for name, outcomes in spent.items():
        scores = [outcome for outcome in outcomes if not isinstance(outcome, Failure)]
        if len(scores) == len(blocks):
            log.info("%s: %s took %.2f s", work.scenario, name, sum(score.seconds for score in scores))

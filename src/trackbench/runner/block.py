"""Blocks of runs: their measurements, the drives of trackers through them, and the sums that result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results import Failure
from trackbench.results.columns import Record
from trackbench.runner.answer_records import answer_records
from trackbench.runner.batches import Batch, batches_of
from trackbench.runner.recorded import OnRecordedRun, Outcome, RecordedEstimates, RecordedScans
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.config import FilterConfig


@dataclass
class Block:
    """Results of one block of runs, such as each tracker's outcome, numbers of detections, and the recorded scans."""

    piece: BlockRuns
    outcomes: dict[str, Outcome | Failure]
    """Outcome or failure of each tracker in the block, by name of the tracker."""
    detections: dict[str, int]
    """Number of detections that objects caused, by sensor."""
    digests: list[bytes]
    """Hash of the measurements of each run."""
    engines: dict[str, EngineUsed]
    """Engine that computed each built-in tracker, by name of the tracker."""
    recorded_scans: RecordedScans | None
    """Scans of the recorded run; None if that run is in another block."""
    answers: list[Record] = field(default_factory=list)
    """Answers of the trackers that did not fail, one record per run; empty unless answers are kept."""
    random: frozenset[str] = frozenset()
    """Names of the plug-ins that declare that they draw random numbers."""

    def add(self, tracker: TrackerRun, outcome: Outcome | Failure, engine: EngineUsed | None) -> None:
        """Add a tracker's outcome, its engine, and whether it draws random numbers."""
        self.outcomes[tracker.name] = outcome
        if engine is not None:
            self.engines[tracker.name] = engine
        if tracker.random:
            self.random |= {tracker.name}

    @property
    def recorded(self) -> dict[str, RecordedEstimates | RecordedTracks]:
        """Estimates or tracks in the recorded run, by name of the tracker; empty if that run is in another block."""
        outcomes = {name: item for name, item in self.outcomes.items() if not isinstance(item, Failure)}
        return {name: item.recorded for name, item in outcomes.items() if item.recorded is not None}


def failures_and_outcomes(
    trackers: Iterable[str], blocks: Sequence[Block]
) -> tuple[dict[str, Failure], dict[str, list[Any]]]:
    """Return the failure of each tracker that failed in any block, and all outcomes of each other tracker."""
    failures: dict[str, Failure] = {}
    outcomes: dict[str, list[Any]] = {}
    for name in trackers:
        of_blocks = [block.outcomes[name] for block in blocks]
        failure = next((outcome for outcome in of_blocks if isinstance(outcome, Failure)), None)
        if failure is None:
            outcomes[name] = of_blocks
        else:
            failures[name] = failure
    return failures, outcomes


class Blocks:
    """Blocks of runs that are simulated and tracked together, with their measurements.

    With hidden identities a built-in tracker processes the runs of all blocks as one batch. ``on_recorded_run`` gets
    the recorded run, if it is in one of these blocks and identities are known.
    """

    def __init__(self, work: Work, group: Sequence[BlockRuns], on_recorded_run: OnRecordedRun | None) -> None:
        self._work, self._observe = work, on_recorded_run
        self._batches, self._joined = batches_of(work, group)
        self.blocks = [self._block(piece, batch) for piece, batch in zip(group, self._batches, strict=True)]

    def tracker_runs(self, name: str) -> Iterator[TrackerRun]:
        """Yield a fresh drive of the tracker for each batch; finish a drive before asking for the next one."""
        built_in = isinstance(self._work.trackers[name], FilterConfig)
        for batch in self._joined if built_in else self._batches:
            run = self._run(name, batch)
            yield run
            if run.failure is not None and len(batch.pieces) > 1:
                # Each scene is driven alone, to find in which ones the tracker fails, and when.
                for single in self._batches:
                    run = self._run(name, single)
                    yield run
                    self._add(run)
            else:
                self._add(run)

    def _block(self, piece: BlockRuns, batch: Batch) -> Block:
        counts, digests = batch.measurements.detected(), batch.measurements.digests
        return Block(piece, {}, counts, digests, {}, batch.recorded_scans(self._observe))

    def _run(self, name: str, batch: Batch) -> TrackerRun:
        twice = batch.pieces == [self._work.driven_twice]
        return TrackerRun(self._work, batch, name, twice, self._observe)

    def _add(self, run: TrackerRun) -> None:
        outcomes = run.close()
        answers = {}
        if run.answers and not isinstance(outcomes, Failure):
            answers = answer_records(self._work, run.batch, run.name, run.answers)
        for place, piece in enumerate(run.batch.pieces):
            outcome = outcomes if isinstance(outcomes, Failure) else outcomes[place]
            engine = run.engine if run.engine is None or place == 0 else run.engine._replace(again=0)
            block = next(block for block in self.blocks if block.piece == piece)
            block.add(run, outcome, engine)
            block.answers += answers.get(piece, [])

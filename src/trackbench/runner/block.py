"""The measurements of a group of blocks, the trackers that go through them, and what these leave behind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results import Failure
from trackbench.results.columns import Record
from trackbench.runner.batches import Batch, batches_of
from trackbench.runner.kept_answers import answer_records
from trackbench.runner.recorded import OnRecordedRun, Outcome, RecordedEstimates, RecordedScans
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.config import FilterConfig


@dataclass
class Block:
    """What a block of runs leaves behind."""

    piece: BlockRuns
    outcomes: dict[str, Outcome | Failure]
    """By tracker."""
    detections: dict[str, int]
    """By sensor, the number of detections of objects."""
    digests: list[bytes]
    """A fingerprint of each run's measurements."""
    engines: dict[str, EngineUsed]
    """By built-in tracker, what computed it."""
    recorded_scans: RecordedScans | None
    """Those of the recorded run, if it is in this block."""
    answers: list[Record] = field(default_factory=list)
    """Answers of the trackers that did not fail, a record a run, where they are kept."""
    random: frozenset[str] = frozenset()
    """The plug-ins that say that they draw random numbers."""

    def add(self, tracker: TrackerRun, outcome: Outcome | Failure, engine: EngineUsed | None) -> None:
        """Add what a tracker leaves, what computed it, and what it says of itself."""
        self.outcomes[tracker.name] = outcome
        if engine is not None:
            self.engines[tracker.name] = engine
        if tracker.random:
            self.random |= {tracker.name}

    @property
    def recorded(self) -> dict[str, RecordedEstimates | RecordedTracks]:
        """By tracker that has not failed, what it gave in the recorded run, if that is in this block."""
        outcomes = {name: item for name, item in self.outcomes.items() if not isinstance(item, Failure)}
        return {name: item.recorded for name, item in outcomes.items() if item.recorded is not None}


def failures_and_outcomes(
    trackers: Iterable[str], blocks: Sequence[Block]
) -> tuple[dict[str, Failure], dict[str, list[Any]]]:
    """By tracker, the first failure of those that failed in any block; of the others what each block leaves."""
    failures: dict[str, Failure] = {}
    outcomes: dict[str, list[Any]] = {}
    for name in trackers:
        every = [block.outcomes[name] for block in blocks]
        failure = next((outcome for outcome in every if isinstance(outcome, Failure)), None)
        if failure is None:
            outcomes[name] = every
        else:
            failures[name] = failure
    return failures, outcomes


class Blocks:
    """A group of blocks, with their measurements.

    With hidden identities built-in trackers take the runs of all blocks at once.

    Args:
        work: what all blocks share.
        group: the runs of each block.
        on_recorded_run: called with the recorded run, if it is in one of these blocks and identities are known.
    """

    def __init__(self, work: Work, group: Sequence[BlockRuns], on_recorded_run: OnRecordedRun | None) -> None:
        self._work, self._observe = work, on_recorded_run
        self._batches, self._together = batches_of(work, group)
        self.blocks = [self._block(piece, batch) for piece, batch in zip(group, self._batches, strict=True)]

    def tracker_runs(self, name: str) -> Iterator[TrackerRun]:
        """The tracker, afresh for each batch; a run is to be finished before the next one is asked for."""
        built_in = isinstance(self._work.trackers[name], FilterConfig)
        for batch in self._together if built_in else self._batches:
            run = self._run(name, batch)
            yield run
            if run.failure is not None and len(batch.pieces) > 1:
                # Each scene says for itself how far the tracker came.
                for own in self._batches:
                    run = self._run(name, own)
                    yield run
                    self._add(run)
            else:
                self._add(run)

    def _block(self, piece: BlockRuns, batch: Batch) -> Block:
        seen = batch.measurements
        return Block(piece, {}, seen.detected(), seen.digests, {}, batch.recorded_scans(self._observe))

    def _run(self, name: str, batch: Batch) -> TrackerRun:
        twice = batch.pieces == [self._work.driven_twice]
        return TrackerRun(self._work, batch, name, twice, self._observe)

    def _add(self, run: TrackerRun) -> None:
        outcomes = run.close()
        kept = {}
        if run.answers and not isinstance(outcomes, Failure):
            kept = answer_records(self._work, run.batch, run.name, run.answers)
        for place, piece in enumerate(run.batch.pieces):
            outcome = outcomes if isinstance(outcomes, Failure) else outcomes[place]
            engine = run.engine if run.engine is None or place == 0 else run.engine._replace(again=0)
            block = next(block for block in self.blocks if block.piece == piece)
            block.add(run, outcome, engine)
            block.answers += kept.get(piece, [])

"""The measurements of a group of blocks, the trackers that go through them, and what these leave behind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from trackbench.base.types import Scan, of_runs, scan_of_run
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results import Failure
from trackbench.runner.recorded import Outcome, RecordedEstimates, RecordedInstant, RecordedScans
from trackbench.runner.targets import Targets
from trackbench.runner.tracker_run import Batch, TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import scenes_side_by_side, sense_hidden
from trackbench.sensing.scans import Measurements, sense_known
from trackbench.trackers.config import FilterConfig

#: Called with the recorded run while it is made: with its scans first, then with the estimates of one tracker after the
#: other at each instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]


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
        self.blocks: list[Block] = []
        self._work, self._observe, self._batches = work, on_recorded_run, list[Batch]()
        sense = sense_hidden if work.hidden else sense_known
        for piece in group:
            seen = sense(work.scenes[piece.scene].sensors, work.seed, work.noise_of(piece.scene), piece.runs)
            recorded = _recorded_scans(work, seen, piece)
            self.blocks.append(Block(piece, {}, seen.detected(), seen.digests, {}, recorded))
            self._batches.append(Batch([piece], seen, None if work.hidden else Targets(work, piece, seen)))
            if on_recorded_run is not None and recorded is not None and not work.hidden:
                on_recorded_run(recorded.scans)
        self._together = self._batches
        if work.hidden:
            together = scenes_side_by_side([batch.measurements for batch in self._batches])
            self._together = [Batch(group, together, None)]

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

    def _run(self, name: str, batch: Batch) -> TrackerRun:
        twice = batch.pieces == [self._work.driven_twice] and len(self.blocks) == 1
        return TrackerRun(self._work, batch, name, twice, self._observe)

    def _add(self, run: TrackerRun) -> None:
        outcomes = run.close()
        for place, piece in enumerate(run.batch.pieces):
            outcome = outcomes if isinstance(outcomes, Failure) else outcomes[place]
            engine = run.engine if run.engine is None or place == 0 else run.engine._replace(again=0)
            next(block for block in self.blocks if block.piece == piece).add(run, outcome, engine)


def _recorded_scans(work: Work, seen: Measurements, piece: BlockRuns) -> RecordedScans | None:
    """Those of the recorded run, if it is one of these."""
    kept, scene = work.recorded_in(piece), work.scenes[piece.scene]
    if kept is None:
        return None
    if not work.hidden:
        return RecordedScans([_of_run(scan, len(scene.truth.ids), kept) for scan in seen.scans])
    pairs = zip(seen.scans, seen.origins, strict=True)
    return RecordedScans(
        [scan_of_run(scan, kept) for scan in seen.scans],
        [origins[scan.valid[:, kept], kept] for scan, origins in pairs],
        of_runs(scene.due.status, range(work.recorded_run, work.recorded_run + 1))[..., 0],
    )


def _of_run(scan: Scan, objects: int, run: int) -> Scan:
    members = slice(run, None, scan.valid.size // objects)
    return scan._replace(measurement=scan.measurement[:, members].copy(), valid=scan.valid[members].copy())

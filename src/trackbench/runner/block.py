"""The measurements of a group of blocks, the trackers that go through them, and what these leave behind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.base.types import Array, Scan, of_runs, scan_of_run
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results import Failure
from trackbench.runner.filed_run import FiledRun
from trackbench.runner.hidden_run import HiddenBatch, HiddenRun
from trackbench.runner.labelled_run import LabelledRun
from trackbench.runner.recorded import Outcome, RecordedEstimates, RecordedInstant, RecordedScans
from trackbench.runner.start import SecondDrives
from trackbench.runner.targets import Targets
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import HiddenMeasurements, scenes_side_by_side, sense_hidden
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
    detections: dict[str, float]
    """By sensor, the number of detections of objects."""
    digests: list[bytes]
    """A fingerprint of each run's measurements."""
    engines: dict[str, EngineUsed]
    """By built-in tracker, what computed it."""
    recorded_scans: RecordedScans | None
    """Those of the recorded run, if it is in this block."""
    random: frozenset[str] = frozenset()
    """The plug-ins that say that they draw random numbers."""
    spreads: dict[str, list[Array]] = field(default_factory=dict)
    """Sums of ``RunSpread`` for each plug-in."""

    def add(self, tracker: TrackerRun[Any], outcome: Outcome | Failure, engine: EngineUsed | None) -> None:
        """Add what a tracker leaves, what computed it, and what it says of itself."""
        self.outcomes[tracker.name] = outcome
        if engine is not None:
            self.engines[tracker.name] = engine
        if tracker.random:
            self.random |= {tracker.name}
        if tracker.spread is not None and tracker.failure is None:
            self.spreads[tracker.name] = tracker.spread.sums

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


class KnownBlocks:
    """Blocks with known identities.

    Args:
        work: what all blocks share.
        group: the runs of each block.
        on_recorded_run: called with the recorded run, if it is in one of these blocks.
    """

    def __init__(self, work: Work, group: Sequence[BlockRuns], on_recorded_run: OnRecordedRun | None) -> None:
        self.blocks: list[Block] = []
        self._work, self._observe = work, on_recorded_run
        self._targets, self._second_drives = [], []
        for piece in group:
            sensors = work.scenes[piece.scene].sensors
            measurements = sense_known(sensors, work.seed, work.noise_of(piece.scene), piece.runs)
            block = _sensed_block(work, piece, measurements)
            self.blocks.append(block)
            self._targets.append(Targets(work, piece, measurements))
            self._second_drives.append(_second_drives(work, [piece]))
            if on_recorded_run is not None and block.recorded_scans is not None:
                on_recorded_run(block.recorded_scans.scans)

    def tracker_runs(self, name: str) -> Iterator[LabelledRun]:
        """The tracker, afresh for each block; a run is to be finished before the next one is asked for."""
        for block, targets, second_drives in zip(self.blocks, self._targets, self._second_drives, strict=True):
            run = LabelledRun(self._work, block.piece, name, targets, second_drives, self._observe)
            yield run
            block.add(run, run.close(), run.engine)


class HiddenBlocks:
    """Blocks with hidden identities; built-in trackers take the runs of all at once.

    Args:
        work: what all blocks share.
        group: the runs of each block.
    """

    def __init__(self, work: Work, group: Sequence[BlockRuns], _: OnRecordedRun | None) -> None:
        self.blocks: list[Block] = []
        self._work, self._alone = work, list[HiddenBatch]()
        for piece in group:
            hidden = sense_hidden(work.scenes[piece.scene].sensors, work.seed, work.noise_of(piece.scene), piece.runs)
            self._alone.append(HiddenBatch([piece], hidden))
            self.blocks.append(_sensed_block(work, piece, hidden))
        together = scenes_side_by_side([batch.measurements for batch in self._alone])
        self._together = HiddenBatch(group, together)

    def tracker_runs(self, name: str) -> Iterator[HiddenRun]:
        """The tracker, afresh for each batch; a run is to be finished before the next one is asked for."""
        batches = [self._together] if isinstance(self._work.trackers[name], FilterConfig) else self._alone
        for batch in batches:
            run = self._run(name, batch)
            yield run
            if run.failure is not None and len(batch.pieces) > 1:
                # Each scene says for itself how far the tracker came.
                for own in self._alone:
                    run = self._run(name, own)
                    yield run
                    self._add(run)
            else:
                self._add(run)

    def _run(self, name: str, batch: HiddenBatch) -> HiddenRun:
        of = FiledRun if name in self._work.filed else HiddenRun
        return of(self._work, batch, name, _second_drives(self._work, batch.pieces))

    def _add(self, run: HiddenRun) -> None:
        outcomes = run.close()
        for place, piece in enumerate(run.pieces):
            outcome = outcomes if isinstance(outcomes, Failure) else outcomes[place]
            engine = run.engine if run.engine is None or place == 0 else run.engine._replace(again=0)
            next(block for block in self.blocks if block.piece == piece).add(run, outcome, engine)


def _second_drives(work: Work, pieces: Sequence[BlockRuns]) -> SecondDrives | None:
    return SecondDrives(work, pieces[0]) if [*pieces] == [work.driven_twice] else None


def _sensed_block(work: Work, piece: BlockRuns, measurements: Measurements | HiddenMeasurements) -> Block:
    """A block that no tracker has gone through yet."""
    kept = work.recorded_in(piece)
    recorded = None if kept is None else _recorded_scans(work, measurements, kept)
    return Block(piece, {}, _detections(measurements), measurements.digests, {}, recorded)


def _recorded_scans(work: Work, measurements: Measurements | HiddenMeasurements, kept: int) -> RecordedScans:
    scene = work.scenes[work.recorded_scene]
    if isinstance(measurements, Measurements):
        return RecordedScans([_of_run(scan, len(scene.truth.ids), kept) for scan in measurements.scans])
    pairs = zip(measurements.scans, measurements.origins, strict=True)
    return RecordedScans(
        [scan_of_run(scan, kept) for scan in measurements.scans],
        [origins[scan.valid[:, kept], kept] for scan, origins in pairs],
        of_runs(scene.due.status, range(work.recorded_run, work.recorded_run + 1))[..., 0],
    )


def _of_run(scan: Scan, objects: int, run: int) -> Scan:
    members = slice(run, None, scan.valid.size // objects)
    return scan._replace(measurement=scan.measurement[:, members].copy(), valid=scan.valid[members].copy())


def _detections(measurements: Measurements | HiddenMeasurements) -> dict[str, float]:
    """By sensor, the number of detections of objects."""
    if isinstance(measurements, Measurements):
        return {name: float(count.sum()) for name, count in measurements.detections.items()}
    counts: dict[str, float] = {}
    for scan, origins in zip(measurements.scans, measurements.origins, strict=True):
        counts[scan.sensor] = counts.get(scan.sensor, 0.0) + float(np.count_nonzero(origins >= 0))
    return counts

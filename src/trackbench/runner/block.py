"""Blocks of Monte-Carlo runs through every tracker, wherever they are made."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np

from trackbench.base.execution import Executor
from trackbench.base.types import Array, Gaussian, Progress, Scan, no_progress, of_runs, scan_of_run
from trackbench.engine.choice import users_kernels_compared
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.breakdown import sum_classes
from trackbench.results import Failure
from trackbench.runner.filed_run import FiledRun
from trackbench.runner.first_velocity import first_velocities
from trackbench.runner.hidden_run import HiddenBatch, HiddenRun, TrafficScores
from trackbench.runner.labelled_run import LabelledOutcome, LabelledRun, score_labelled_runs
from trackbench.runner.recorded import RecordedEstimates, RecordedInstant, RecordedScans
from trackbench.runner.start import SecondDrives
from trackbench.runner.targets import Targets
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.sensing.detections import HiddenMeasurements, scenes_side_by_side, sense_hidden
from trackbench.sensing.scans import Measurements, sense_known
from trackbench.trackers.config import FilterConfig

#: Called with the recorded run while it is made: with its scans first, then with the estimates at each instant.
OnRecordedRun = Callable[[list[Scan] | RecordedInstant], None]
Outcome = LabelledOutcome | TrafficScores | Failure

#: Parameters of mallopt(3), from malloc.h.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
#: The largest that glibc takes, bytes.
LARGEST = 32 * 2**20


@dataclass
class Block:
    """What a block of runs leaves behind."""

    piece: BlockRuns
    outcomes: dict[str, Outcome]
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
    first_velocities: Mapping[str, Array] = field(default_factory=dict)
    """As ``first_velocity`` has them, in the first block of each scene."""
    spreads: dict[str, list[Array]] = field(default_factory=dict)
    """Sums of ``RunSpread`` for each plug-in."""

    def add(self, tracker: TrackerRun[Any], outcome: Outcome, engine: EngineUsed | None) -> None:
        """Add what a tracker leaves, what computed it, and what it says of itself."""
        self.outcomes[tracker.name] = outcome
        if engine is not None:
            self.engines[tracker.name] = engine
        if tracker.random:
            self.random |= {tracker.name}
        if tracker.spread is not None and tracker.failure is None:
            self.spreads[tracker.name] = tracker.spread.sums

    @property
    def recorded(self) -> dict[str, RecordedEstimates]:
        """With known identities, by tracker its estimates of the recorded run, if it is in this block."""
        labelled = {name: item for name, item in self.outcomes.items() if isinstance(item, LabelledOutcome)}
        return {name: item.recorded for name, item in labelled.items() if item.recorded is not None}


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


def run_block(
    work: Work, piece: BlockRuns, progress: Progress = no_progress, on_recorded_run: OnRecordedRun | None = None
) -> Block:
    """A single block; as ``run_blocks``."""
    (block,) = run_blocks(work, [piece], progress, on_recorded_run)
    return block


def run_blocks(
    work: Work,
    group: Sequence[BlockRuns],
    progress: Progress = no_progress,
    on_recorded_run: OnRecordedRun | None = None,
) -> list[Block]:
    """Synthesise the measurements of some runs, take every tracker through them and score it.

    Args:
        work: what all blocks share.
        group: a group of ``Work.groups``.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
        on_recorded_run: called with the recorded run, if it is in one of these blocks and identities are known.
    """
    keep_freed_memory()
    with users_kernels_compared(work.engine_here, group[0].scene == group[0].runs.start == 0):
        if work.cutoff is not None:
            return _run_hidden(work, group, progress)
        return [_run_labelled(work, piece, progress, on_recorded_run) for piece in group]


def _sensed_block(work: Work, piece: BlockRuns, measurements: Measurements | HiddenMeasurements) -> Block:
    """A block that no tracker has gone through yet."""
    kept = work.recorded_in(piece)
    recorded = None if kept is None else _recorded_scans(work, measurements, kept)
    block = Block(piece, {}, _detections(measurements), measurements.digests, {}, recorded)
    if piece.runs.start == 0 and work.has_truth:
        block.first_velocities = first_velocities(work.trackers, measurements, len(work.scenes[piece.scene].truth.ids))
    return block


def _run_labelled(work: Work, piece: BlockRuns, progress: Progress, on_recorded_run: OnRecordedRun | None) -> Block:
    scene, runs = work.scenes[piece.scene], piece.runs
    second_drives = SecondDrives(work, piece) if piece == work.driven_twice else None
    measurements = sense_known(scene.sensors, work.seed, work.noise_of(piece.scene), runs)
    block, targets = _sensed_block(work, piece, measurements), Targets(work, piece, measurements)
    observe = None
    if on_recorded_run is not None and block.recorded_scans is not None:
        observe = on_recorded_run
        observe(block.recorded_scans.scans)
    steps, taken = len(scene.instants()) * len(work.trackers), itertools.count(1)
    # One tracker after the other where nobody looks on: the memory of one is that of the next.
    for names in [[*work.trackers]] if observe is not None else [[name] for name in work.trackers]:
        trackers = {name: LabelledRun(work, piece, name, targets, second_drives) for name in names}
        _advance(trackers, len(scene.instants()), lambda: progress(next(taken) / steps * len(runs), len(runs)), observe)
        for tracker in trackers.values():
            outcome = tracker.close()
            if isinstance(outcome, LabelledOutcome):
                sum_classes(outcome.scores)
            block.add(tracker, outcome, tracker.engine)
    return block


def _run_hidden(work: Work, pieces: Sequence[BlockRuns], progress: Progress) -> list[Block]:
    """Blocks with hidden identities; built-in trackers take the runs of all at once."""
    alone, blocks = [], []
    for piece in pieces:
        hidden = sense_hidden(work.scenes[piece.scene].sensors, work.seed, work.noise_of(piece.scene), piece.runs)
        alone.append(HiddenBatch([piece], hidden))
        blocks.append(_sensed_block(work, piece, hidden))
    together = [HiddenBatch(pieces, scenes_side_by_side([batch.measurements for batch in alone]))]
    runs, taken = sum(len(piece.runs) for piece in pieces), itertools.count(1)
    for name, entry in work.trackers.items():
        batches = together if isinstance(entry, FilterConfig) else alone
        trackers = [_hidden_run(work, name, batch) for batch in batches]
        if len(pieces) > len(trackers) and trackers[0].failure is not None:
            # Each scene says for itself how far the tracker came.
            trackers = [_hidden_run(work, name, batch) for batch in alone]
        for tracker in trackers:
            outcomes, engine = tracker.close(), tracker.engine
            for place, piece in enumerate(tracker.pieces):
                outcome = outcomes if isinstance(outcomes, Failure) else outcomes[place]
                own = engine if engine is None or place == 0 else engine._replace(again=0)
                blocks[pieces.index(piece)].add(tracker, outcome, own)
        progress(next(taken) / len(work.trackers) * runs, runs)
    return blocks


def _hidden_run(work: Work, name: str, batch: HiddenBatch) -> HiddenRun:
    """A tracker that has taken all scans."""
    (piece, *more) = batch.pieces
    second_drives = SecondDrives(work, piece) if piece == work.driven_twice and not more else None
    tracker = (FiledRun if name in work.filed else HiddenRun)(work, batch, name, second_drives)
    for _ in range(tracker.chunk):
        tracker.advance()
    return tracker


def _advance(
    trackers: Mapping[str, LabelledRun], count: int, step: Callable[[], None], observe: OnRecordedRun | None
) -> None:
    """Take trackers side by side through so many instants, and score them; ``step`` is called after each step of one,
    ``observe`` with the estimates of the recorded run at each instant."""
    labelled = [*trackers.values()]
    instant = 0
    while instant < count:
        many = labelled[0].advance_many(instant) if observe is None else 0
        for _ in range(many):
            step()
        instant += many
        if many:
            continue
        estimates: dict[str, Gaussian] = {}
        for name, tracker in trackers.items():
            estimate = tracker.advance()
            if estimate is not None:
                estimates[name] = estimate
            step()
        if observe is not None:
            observe(RecordedInstant(instant, estimates))
        instant += 1
        if instant == count or any(tracker.scorer.full for tracker in labelled):
            score_labelled_runs(labelled)


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


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed arrays for the next step, where it would return them to the system.

    At first glibc maps every block of more than 128 KiB from the system and unmaps it again, so that each step of a
    filter waits for fresh pages: a fifth of the time of an extended Kalman filter, and three quarters in a Dask worker,
    whose environment fixes the limits low. Other C libraries are not affected.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST)
        mallopt(M_TRIM_THRESHOLD, 2 * LARGEST)


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
        of_scenes, is_here = cache(work.of_scenes), []
        here: list[tuple[Work, list[BlockRuns]]] = []
        there: list[tuple[Work, list[BlockRuns]]] = []
        for group in self._groups:
            call = of_scenes(tuple(dict.fromkeys(piece.scene for piece in group))), group
            is_here.append((alone and len(self._groups) == 1) or (observed and any(map(work.has_recorded_run, group))))
            (here if is_here[-1] else there).append(call)
        observers = self._advance, self._observe if observed else None
        blocks_here = Executor().map(run_blocks, here, observers=observers)
        blocks_there = executor.map(run_blocks, there, own_folder(loaded), observers)
        self._blocks = (next(blocks_here if is_local else blocks_there) for is_local in is_here)

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
        for group, made in zip(self._groups, self._blocks, strict=True):
            blocks += made
            self._done += sum(len(piece.runs) for piece in group)
            self._progress(self._done, self._total)
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

"""Blocks of runs: their measurements, the drives of trackers through them, and the sums that result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.base.types import Estimate, Tracks
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.results import Failure
from trackbench.results.columns import Record
from trackbench.runner.batches import Batch, batches_of
from trackbench.runner.recorded import OnRecordedRun, Outcome, RecordedEstimates, RecordedScans, state_columns
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import fingerprint_of
from trackbench.trackers.answers import NO_TRACK
from trackbench.trackers.config import FilterConfig


@dataclass
class Block:
    """Results of one block of runs: each tracker's sums of scores, numbers of detections, and the recorded scans."""

    piece: BlockRuns
    outcomes: dict[str, Outcome | Failure]
    """Outcome (sums of scores) or failure of each tracker in the block, by name of the tracker."""
    detections: dict[str, int]
    """Number of detections that objects caused, by sensor."""
    digests: list[bytes]
    """Hash of the measurements of each run."""
    engines: dict[str, EngineUsed]
    """Engine that computed each built-in tracker, by name of the tracker."""
    recorded_scans: RecordedScans | None
    """Scans of the recorded run (the run that is kept for plots); None if that run is in another block."""
    answers: list[Record] = field(default_factory=list)
    """Answers of the trackers that did not fail, one record per run; empty unless answers are kept."""
    random: frozenset[str] = frozenset()
    """Names of the plug-ins that declare that they draw random numbers."""

    @property
    def recorded(self) -> dict[str, RecordedEstimates | RecordedTracks]:
        """Estimates or tracks in the recorded run (kept for plots), by tracker; empty if it is in another block."""
        outcomes = {name: item for name, item in self.outcomes.items() if not isinstance(item, Failure)}
        return {name: item.recorded for name, item in outcomes.items() if item.recorded is not None}


def failures_and_outcomes(
    trackers: Iterable[str], blocks: Sequence[Block]
) -> tuple[dict[str, Failure], dict[str, list[Any]]]:
    """Return, by tracker, the first failure of each one that failed, and the sums of scores per block of each other."""
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
    the recorded run (kept for plots), if that run is in one of these blocks and identities are known.
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
            answers = _answer_records(self._work, run.batch, run.name, run.answers)
        for place, piece in enumerate(run.batch.pieces):
            block = next(block for block in self.blocks if block.piece == piece)
            block.outcomes[run.name] = outcomes if isinstance(outcomes, Failure) else outcomes[place]
            if run.engine is not None:
                block.engines[run.name] = run.engine if place == 0 else run.engine._replace(again=0)
            if run.random:
                block.random |= {run.name}
            block.answers += answers.get(piece, [])


def _answer_records(work: Work, batch: Batch, name: str, answers: Sequence[Any]) -> dict[BlockRuns, list[Record]]:
    """Return a tracker's answers at each instant, one record per run, by block of runs."""
    records, first = dict[BlockRuns, list[Record]](), 0
    for piece in batch.pieces:
        scene = work.scenes[piece.scene]
        time = scene.truth.time[scene.instants()]
        records[piece] = []
        for number, run in enumerate(piece.runs, first):
            columns = _of_tracks(answers, number) if work.hidden else _of_objects(answers, number, batch, scene.truth)
            instant = columns.pop("instant")
            records[piece].append(
                {
                    "tracker": name,
                    "scene": np.full(len(instant), piece.scene),
                    "run": np.full(len(instant), run),
                    "fingerprint": fingerprint_of(batch.measurements.digests[number]),
                    "time_s": time[instant],
                    **columns,
                }
            )
        first += len(piece.runs)
    return records


def _of_tracks(answers: Sequence[Tracks], run: int) -> dict[str, Any]:
    columns = [np.flatnonzero(tracks.ids[:, run] != NO_TRACK) for tracks in answers]
    pairs = [(tracks, column) for tracks, column in zip(answers, columns, strict=True) if len(column)]
    none = np.zeros((4, 4, 0))
    mean = np.concatenate([none[0], *(tracks.mean[:, column, run] for tracks, column in pairs)], axis=1)
    covariance = np.concatenate([none, *(tracks.covariance[:, :, column, run] for tracks, column in pairs)], axis=2)
    existence = [
        np.full(len(column), np.nan) if tracks.existence is None else tracks.existence[column, run]
        for tracks, column in pairs
    ]
    return {
        "instant": np.repeat(np.arange(len(answers)), [len(column) for column in columns]),
        "track": np.concatenate([np.zeros(0, dtype=np.intp), *(tracks.ids[column, run] for tracks, column in pairs)]),
        **state_columns(mean, covariance),
        "existence": np.concatenate([np.zeros(0), *existence]),
    }


def _of_objects(answers: Sequence[Estimate | None], run: int, batch: Batch, truth: Any) -> dict[str, Any]:
    runs = sum(len(piece.runs) for piece in batch.pieces)
    none = np.full((4, 4, len(truth.ids)), np.nan)
    means = [none[0] if answer is None else answer.mean[:, run::runs] for answer in answers]
    covariances = [none if answer is None else answer.covariance[:, :, run::runs] for answer in answers]
    instant, item = np.nonzero(np.isfinite(np.stack(means)[:, 0]))
    return {
        "instant": instant,
        "object": [truth.ids[index] for index in item],
        **state_columns(np.stack(means, axis=1)[:, instant, item], np.stack(covariances, axis=2)[:, :, instant, item]),
    }

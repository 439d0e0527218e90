"""One block of Monte-Carlo runs of detections that nobody labelled, through every tracker."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trackbench.base.types import FALSE_ALARM, Array, Indices, Progress, Scan, Tracks, no_progress, of_runs, scan_of_run
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.remote import start_tracks
from trackbench.driving.tracks import NO_TRACK, BatchedTracks, TracksStepper, tracks_of_run, unread
from trackbench.engine.equations import EngineUsed
from trackbench.metrics.traffic import (
    Associations,
    TrackHistory,
    TrafficScoreOptions,
    TruthHistory,
    score_run,
)
from trackbench.metrics.traffic.histories import NO_DETECTION
from trackbench.metrics.traffic.without_truth import UnlabelledScan, score_without_truth, without_truth
from trackbench.results import Failure
from trackbench.runner.allocation import keep_freed_memory
from trackbench.runner.delivery import deliveries
from trackbench.runner.engines import engine_of
from trackbench.runner.traffic_sums import TrafficSums
from trackbench.runner.unlabelled import judged_scan
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import HiddenMeasurements, sense_hidden
from trackbench.sensing.due import Due
from trackbench.trackers.config import FilterConfig

#: Share of the scans in which a tracker may still load what it needs: of these the time is not counted.
UNTIMED = 0.1
NO_TRACKS_YET = "it had given no tracks; is it of one object? With hidden identities a scan has detections of all"


@dataclass
class TrafficScores:
    """What a block leaves of one tracker."""

    sums: TrafficSums
    reused_ids: Array
    """``(runs,)`` number of ids that were used again after their track had ended."""
    seconds: float
    """Time spent in the tracker, without the first ``UNTIMED`` of the scans."""
    steps: int
    """Number of scans of single runs that it took in this time."""
    recorded: TrackHistory | None = None
    """Its tracks of the recorded run."""
    taken: Indices | None = None
    """``(rows, 3)`` scan, id of the track and number of the detection that it took, in the recorded run."""
    predicted: dict[int, Tracks] = field(default_factory=dict)
    """By number of the scan, the tracks of the recorded run before it, of a built-in tracker that took it."""


@dataclass
class TrafficBlock:
    """What a block of runs leaves behind."""

    piece: BlockRuns
    scores: dict[str, TrafficScores | Failure]
    """By tracker."""
    digests: list[bytes]
    detections: dict[str, tuple[float, float]]
    """By sensor, the numbers of detections of objects and of false alarms."""
    status: npt.NDArray[np.int8]
    """``(instants, objects)`` of the recorded run, of which a block without it has nothing."""
    scans: list[Scan] | None = None
    """Those of the recorded run, if it is in this block."""
    origins: list[Indices] = field(default_factory=list)
    """Of their detections."""
    engines: dict[str, EngineUsed] = field(default_factory=dict)
    """By built-in tracker, what computed it."""


def run_traffic_block(work: Work, piece: BlockRuns, progress: Progress = no_progress, _: object = None) -> TrafficBlock:
    """Synthesise the detections of some runs, take every tracker through them and score its tracks.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        progress: called with the number of runs done and of all; each tracker's part of a run counts alike.
    """
    keep_freed_memory()
    scene, runs = work.scenes[piece.scene], piece.runs
    hidden = sense_hidden(scene.sensors, work.seed, work.noise_of(piece.scene), runs)
    due = scene.due
    kept = work.recorded_run - runs.start if work.has_recorded_run(piece) else None
    scores, engines = {}, {}
    for number, name in enumerate(work.trackers):
        passage = _Passage(work, piece, name, hidden, due, kept)
        scores[name] = passage.scores()
        if passage.engine is not None:
            engines[name] = passage.engine
        progress((number + 1) / len(work.trackers) * len(runs), len(runs))
    found = TrafficBlock(
        piece, scores, hidden.digests, _counts(hidden), np.zeros((0, 0), dtype=np.int8), engines=engines
    )
    if kept is not None:
        found.scans = [scan_of_run(scan, kept) for scan in hidden.scans]
        pairs = zip(hidden.scans, hidden.origins, strict=True)
        found.origins = [origins[scan.valid[:, kept], kept] for scan, origins in pairs]
        found.status = of_runs(due.status, range(work.recorded_run, work.recorded_run + 1))[..., 0]
    return found


class _Passage:
    """One tracker's way through the scans of a block."""

    def __init__(
        self, work: Work, piece: BlockRuns, name: str, hidden: HiddenMeasurements, due: Due, kept: int | None
    ) -> None:
        self._work, self._piece, self._name, self._hidden, self._due, self._kept = work, piece, name, hidden, due, kept
        self._truth = work.scenes[piece.scene].truth
        self._time = self._truth.time[due.steps]
        self._instants: list[Tracks] = []
        self._taken: list[tuple[int, Tracks, int]] = []
        self._asked = range(len(piece.runs)) if not self._truth.known else () if kept is None else (kept,)
        self._predicted: dict[int, dict[int, Tracks]] = {run: {} for run in self._asked}
        self._seconds, self._timed, self._timed_from = 0.0, 0, int(UNTIMED * len(hidden.scans))
        self._options = TrafficScoreOptions(cutoff=work.cutoff or 5.0)
        self.engine: EngineUsed | None = None
        """Known once it was taken through, of a built-in tracker."""

    def scores(self) -> TrafficScores | Failure:
        """Those of each run; or why the tracker cannot go on."""
        instant, scan = 0, self._hidden.scans[0]
        try:
            work = self._work
            stepper = start_tracks(
                work.trackers[self._name], work.folder, len(self._piece.runs), work.isolation, work.engine_here
            )
        except Exception as error:
            return self._failure(fault_of(error), 0, None)
        try:
            named = self._work.trackers[self._name].sensors_used
            given = deliveries(self._hidden.scans, lambda sensor: named is None or sensor in named, unread)
            nothing = np.zeros((0, len(self._piece.runs)), dtype=np.intp)
            stepped = 0
            for instant, group in enumerate(given):
                for scan, number, read in group:
                    if read and number is not None and scan.arrival_time == scan.time:
                        self._predict(stepper, scan.time, number)
                    origins = self._hidden.origins[number] if read and number is not None else nothing
                    begin = time.perf_counter()
                    tracks = stepper.step(scan, origins)
                    if stepped >= self._timed_from:
                        self._seconds += time.perf_counter() - begin
                        self._timed += 1
                    stepped += 1
                    if read and number is not None:
                        self._taken.append((instant, tracks, number))
                self._instants.append(tracks)
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            return self._failure(self._explained(fault_of(error)), instant, scan.sensor)
        finally:
            self.engine = engine_of(work, stepper)
            stepper.close()
        return self._scored()

    def _predict(self, stepper: TracksStepper, time: float, number: int) -> None:
        """Keep what a built-in tracker expects before a scan; others could be changed by the question."""
        if isinstance(self._work.trackers[self._name], FilterConfig) and isinstance(stepper, BatchedTracks):
            for run in self._asked:
                self._predicted[run][number] = stepper.predicted(time, run)

    def _scored(self) -> TrafficScores:
        runs = self._piece.runs
        tracks = _stacked(self._instants)
        state = np.stack([self._truth.px, self._truth.py, self._truth.vx, self._truth.vy])[:, self._due.steps]
        steps = self._timed * len(runs)
        found = TrafficScores(TrafficSums(), np.zeros(len(runs)), self._seconds, steps)
        taken = self._associations() if self._truth.known else None
        for run in range(len(runs)):
            one = range(runs.start + run, runs.start + run + 1)
            truth = TruthHistory(self._time, of_runs(state, one)[..., 0], of_runs(self._due.status, one)[..., 0])
            history = _of_run(tracks, run)
            own = None if taken is None else _associations_of(taken, run)
            if self._truth.known:
                scores = score_run(truth, history, self._options, own)
            else:
                scores = without_truth(score_without_truth(self._judged_scans(run)))
            number = self._work.number(self._piece.scene, runs.start + run)
            found.sums.add(number, scores, recorded=run == self._kept)
            found.reused_ids[run] = reused(history.ids)
            if run == self._kept:
                found.recorded, found.taken = history, self._detections_taken(run)
                found.predicted = self._predicted[run]
        return found

    def _associations(self) -> Associations | None:
        """Which detection each track took in every run: arrays ``(scans, ..., runs)``; None where it does not say."""
        if not self._taken or any(tracks.used is None and tracks.ids.size for _, tracks, _ in self._taken):
            return None
        runs, objects = len(self._piece.runs), len(self._truth.ids)
        shape = (len(self._taken), max(len(tracks.ids) for _, tracks, _ in self._taken), runs)
        ids, origin = np.full(shape, NO_TRACK), np.full(shape, NO_DETECTION)
        merged, detected = np.full(shape, NO_TRACK), np.zeros((shape[0], objects, runs), dtype=bool)
        for row, (_, tracks, number) in enumerate(self._taken):
            origins, second = self._hidden.origins[number], self._hidden.merged[number]
            for caused in (origins, second):
                column, run = np.nonzero(caused >= 0)
                detected[row, caused[column, run], run] = True
            if tracks.used is None or not len(tracks.ids):
                continue
            ids[row, : len(tracks.ids)] = tracks.ids
            track, run = np.nonzero(tracks.used >= 0)
            took = tracks.used[track, run]
            origin[row, track, run], merged[row, track, run] = origins[took, run], second[took, run]
        return Associations(np.array([instant for instant, _, _ in self._taken]), ids, origin, detected, merged)

    def _judged_scans(self, run: int) -> list[UnlabelledScan]:
        """What the tracker said of each scan that it took, in a run of a recording without a truth."""
        sensors = {sensor.name: sensor.config for sensor in self._work.scenes[self._piece.scene].sensors}
        found = []
        for _, tracks, number in self._taken:
            scan = scan_of_run(self._hidden.scans[number], run)
            own_track = self._hidden.origins[number][: len(scan.valid), run]
            predicted = self._predicted[run].get(number)
            found.append(judged_scan(scan, own_track, sensors[scan.sensor], predicted, tracks_of_run(tracks, run)))
        return found

    def _detections_taken(self, run: int) -> Indices:
        rows = [
            (number, tracks.ids[column, run], tracks.used[column, run])
            for _, tracks, number in self._taken
            if tracks.used is not None
            for column in np.flatnonzero(tracks.used[:, run] >= 0)
        ]
        return np.array(rows, dtype=np.intp).reshape(-1, 3)

    def _explained(self, fault: TrackFault) -> TrackFault:
        """An error before the first track may be that of a tracker of one object."""
        if fault.kind == "raised" and not any(len(tracks.ids) for tracks in self._instants):
            return TrackFault(f"{fault.cause} ({NO_TRACKS_YET})", fault.kind, fault.place, fault.member)
        return fault

    def _failure(self, fault: TrackFault, instant: int, sensor: str | None) -> Failure:
        where = {"step": instant, "time_s": float(self._time[instant]), "sensor": sensor, "object": None}
        return self._work.failure(self._piece, fault, fault.member, **where)


def reused(ids: Indices) -> int:
    """How many ids ``(T, K)`` come back after an instant without them."""
    instant, column = np.nonzero(ids != NO_TRACK)
    own = ids[instant, column]
    order = np.lexsort((instant, own))
    return int(np.sum((np.diff(own[order]) == 0) & (np.diff(instant[order]) > 1)))


def _stacked(instants: Sequence[Tracks]) -> Tracks:
    """The tracks at all instants: arrays ``(..., T, K, runs)``."""
    most = max(len(tracks.ids) for tracks in instants)
    runs = instants[0].ids.shape[1]
    shape = (len(instants), most, runs)
    ids = np.full(shape, NO_TRACK)
    mean, covariance = np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan)
    existence = np.full(shape, np.nan) if any(tracks.existence is not None for tracks in instants) else None
    for row, tracks in enumerate(instants):
        count = len(tracks.ids)
        ids[row, :count], mean[:, row, :count], covariance[:, :, row, :count] = tracks[:3]
        if existence is not None and tracks.existence is not None:
            existence[row, :count] = tracks.existence
    return Tracks(ids, mean, covariance, existence)


def _of_run(tracks: Tracks, run: int) -> TrackHistory:
    """The history of one run, in no more columns than it needs."""
    ids = tracks.ids[..., run]
    order = np.argsort(ids == NO_TRACK, axis=1, kind="stable")
    order = order[:, : int((ids != NO_TRACK).sum(axis=1).max(initial=0))]
    rows = np.arange(len(ids))[:, None]
    existence = None if tracks.existence is None else tracks.existence[rows, order, run]
    return TrackHistory(
        ids[rows, order], tracks.mean[:, rows, order, run], tracks.covariance[:, :, rows, order, run], existence
    )


def _associations_of(taken: Associations, run: int) -> Associations:
    merged = None if taken.merged is None else taken.merged[..., run]
    return Associations(taken.instant, taken.ids[..., run], taken.origin[..., run], taken.detected[..., run], merged)


def _counts(hidden: HiddenMeasurements) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for scan, origins in zip(hidden.scans, hidden.origins, strict=True):
        objects, alarms = found.get(scan.sensor, (0.0, 0.0))
        found[scan.sensor] = (objects + float((origins >= 0).sum()), alarms + float((origins == FALSE_ALARM).sum()))
    return found

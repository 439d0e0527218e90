"""A tracker of several objects with hidden identities on its way through a block of runs, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from trackbench.base.types import Array, Indices, Tracks, of_runs, scan_of_run
from trackbench.driving.drive import Delivery, DriveStep, TrackerDrive
from trackbench.driving.faults import TrackFault
from trackbench.driving.remote import start
from trackbench.driving.steppers import Batched, Stepper
from trackbench.metrics.evaluate import MetricSums, accumulators
from trackbench.metrics.traffic import (
    Associations,
    RunScores,
    TrackedRun,
    TrackHistory,
    TrackScope,
    TrafficScoreOptions,
    TruthHistory,
    score_run,
)
from trackbench.metrics.traffic.assignment import NO_DETECTION
from trackbench.metrics.traffic.run import in_stretches
from trackbench.metrics.traffic.without_truth import UnlabelledScan, score_without_truth, without_truth
from trackbench.results import Failure
from trackbench.runner.second_drives import SecondDrives
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.traffic_sums import TrafficSums
from trackbench.runner.unlabelled import judged_scan
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import HiddenMeasurements
from trackbench.sensing.view import unscored
from trackbench.trackers.answers import NO_TRACK, tracks_of_run
from trackbench.trackers.config import FilterConfig
from trackbench.truth.recorded.stretches import stretch_of

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
    metrics: MetricSums = field(default_factory=dict)
    """By accumulator."""
    recorded: TrackHistory | None = None
    """Its tracks of the recorded run."""
    taken: Indices | None = None
    """``(rows, 3)`` scan, id of the track and number of the detection that it took, in the recorded run."""
    predicted: dict[int, Tracks] = field(default_factory=dict)
    """By number of the scan, the tracks of the recorded run before it, of a built-in tracker that took it."""
    offset: Array | None = None
    """Of tracks made elsewhere, ``(5, P)``: the run, and the rows of :func:`offset_pairs`."""
    filed: Indices | None = None
    """Of tracks made elsewhere, the numbers of rows, of those within the time of the truth, and of runs without any."""


class HiddenRun(TrackerRun[Tracks]):
    """One tracker; each is scored alone, when it has taken all scans.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        name: of the tracker.
        hidden: the detections of the block.
        kept: number of the recorded run in this block, if it is there.
        second_drives: as of ``TrackerRun``.
    """

    def __init__(
        self,
        work: Work,
        piece: BlockRuns,
        name: str,
        hidden: HiddenMeasurements,
        kept: int | None,
        second_drives: SecondDrives | None,
    ) -> None:
        config, scene = work.trackers[name], work.scenes[piece.scene]
        self._hidden, self._due, self._kept = hidden, scene.due, kept
        self._truth = scene.truth
        self._motion = scene.truth.px, scene.truth.py, scene.truth.vx, scene.truth.vy
        with_engine = partial(replace, engine=work.engine_here)
        drive = TrackerDrive[Tracks](
            lambda: start(
                work.driven(name), work.folder, len(piece.runs), with_engine, work.isolation, True, work.sensors
            ),
            hidden.scans,
            config.sensors_used,
            engine=work.engine_here,
            origins=[np.stack(both) for both in zip(hidden.origins, hidden.merged, strict=True)],
            before=self._predict,
        )
        super().__init__(work, piece, name, drive, scene.truth.time[self._due.steps], second_drives)
        self._tracks_at: list[Tracks] = []
        self._taken: list[tuple[int, Tracks, int]] = []
        self._predicted_runs = range(len(piece.runs)) if not self._truth.known else () if kept is None else (kept,)
        self._predicted: dict[int, dict[int, Tracks]] = {run: {} for run in self._predicted_runs}
        self._seconds, self._timed, self._untimed = 0.0, 0, int(UNTIMED * len(hidden.scans))
        self._outcome: TrafficScores | None = None

    @property
    def chunk(self) -> int:
        """Number of instants after which it is scored: all."""
        return len(self._due.steps)

    def advance(self) -> None:
        """Take the tracker through the next instant, unless it has failed; after the last one, end and score it."""
        super().advance()
        if self.failure is None and len(self._tracks_at) == self.chunk:
            self.end()
            if self.failure is None:
                self._outcome = self._scored()
            # Several trackers' tracks of all instants at once may not fit the memory.
            self._tracks_at, self._taken, self._predicted = [], [], {}

    def close(self) -> TrafficScores | Failure:
        """What it left behind, once all instants were taken."""
        self.end()
        if self.failure is not None:
            return self.failure
        assert self._outcome is not None
        return self._outcome

    def _take(self, step: DriveStep[Tracks]) -> None:
        if self._untimed:
            self._untimed -= 1
        else:
            self._seconds += step.seconds
            self._timed += 1
        if step.read and step.number is not None:
            self._taken.append((step.instant, step.answer, step.number))
        if step.last:
            self._tracks_at.append(step.answer)

    def _predict(self, tracker: Stepper, delivery: Delivery) -> None:
        """Keep what a built-in tracker expects before a scan; others could be changed by the question."""
        scan, number, read = delivery
        if not read or number is None or scan.arrival_time != scan.time:
            return
        if isinstance(self._work.trackers[self.name], FilterConfig) and isinstance(tracker, Batched):
            for run in self._predicted_runs:
                self._predicted[run][number] = tracker.predicted(scan.time, run)

    def _scored(self) -> TrafficScores:
        runs = self._piece.runs
        steps = self._timed * len(runs)
        outcome = TrafficScores(TrafficSums(), np.zeros(len(runs)), self._seconds, steps)
        taken = self._associations() if self._truth.known else None
        histories = self._histories()
        summing = accumulators([item for item in self._work.metrics if self._truth.known or item.without_truth])
        options = TrafficScoreOptions(self._work.cutoff or 5.0, self._work.switch_costs)
        ends, counted = self._stretches()
        scope = TrackScope(self.name, len(counted) if ends else len(runs), options)
        sums = {name: accumulator.init(scope) for name, accumulator in summing.items()}
        for run in range(len(runs)):
            truth, history = histories(run)
            own = None if taken is None else _associations_of(taken, run)
            outside = None
            if self._truth.known:
                if self._truth.unscored is not None:
                    # A track is on an object up to half of the cutoff.
                    x, y = history.mean[:2]
                    outside = unscored(self._truth, self._due.steps, x, y, margin=options.cutoff / 2)
                scores = score_run(truth, history, options, own, outside, ends)
            else:
                scores = self._scored_without_truth(run, ends)
            tracked = TrackedRun(truth, history, own, scores, outside)
            parts = in_stretches(tracked, ends) if ends else [tracked]
            for part in [parts[number] for number in counted] if ends else parts:
                sums = {name: item.update(sums[name], part) for name, item in summing.items()}
            number = self._work.number(self._piece.scene, runs.start + run)
            outcome.sums.add(number, scores, recorded=run == self._kept)
            outcome.reused_ids[run] = reused(history.ids)
            if run == self._kept:
                outcome.recorded, outcome.taken = history, self._detections_taken(run)
                outcome.predicted = self._predicted[run]
        outcome.metrics = {name: item.close(sums[name]) for name, item in summing.items()}
        return outcome

    def _stretches(self) -> tuple[list[int], list[int]]:
        """The instants before which the stretches of a log end, and the numbers of those that count."""
        if not self._work.stretches:
            return [], []
        number = stretch_of(self._time, self._work.stretches)
        ends = np.searchsorted(number, np.arange(self._work.stretches), side="right").tolist()
        return ends, [stretch for scene, stretch in self._work.counted_stretches if scene == self._piece.scene]

    def _scored_without_truth(self, run: int, ends: Sequence[int]) -> RunScores:
        judged = self._judged_scans(run)
        taken = np.searchsorted([instant for instant, _, _ in self._taken], ends).tolist()
        until = tuple(score_without_truth(judged[:number]) if number else {} for number in taken)
        return without_truth(score_without_truth(judged))._replace(until=until)

    def _truth_of(self, run: int) -> TruthHistory:
        """The truth at the instants, in a run counted from the first of the block."""
        single = range(self._piece.runs.start + run, self._piece.runs.start + run + 1)
        state = np.stack([of_runs(part, single)[self._due.steps, :, 0] for part in self._motion])
        return TruthHistory(self._time, state, of_runs(self._due.status, single)[..., 0])

    def _histories(self) -> Callable[[int], tuple[TruthHistory, TrackHistory]]:
        """A function that gives the truth and the tracks of a run."""
        tracks = _stacked(self._tracks_at)
        return lambda run: (self._truth_of(run), _of_run(tracks, run))

    def _associations(self) -> Associations | None:
        """Which detection each track took in every run: arrays ``(scans, ..., runs)``; None where it does not say, or
        where nothing says of which object a detection is."""
        if not self._taken or self._work.scenes[self._piece.scene].unlabelled:
            return None
        if any(tracks.used is None and tracks.ids.size for _, tracks, _ in self._taken):
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
        judged = []
        for _, tracks, number in self._taken:
            scan = scan_of_run(self._hidden.scans[number], run)
            own_track = self._hidden.origins[number][: len(scan.valid), run]
            predicted = self._predicted[run].get(number)
            judged.append(judged_scan(scan, own_track, sensors[scan.sensor], predicted, tracks_of_run(tracks, run)))
        return judged

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
        begun = self._drive.sensor is not None
        if begun and fault.kind == "raised" and not any(len(tracks.ids) for tracks in self._tracks_at):
            return TrackFault(f"{fault.cause} ({NO_TRACKS_YET})", fault.kind, fault.place, fault.member)
        return fault

    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        return None, member


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

"""A tracker of several objects with hidden identities on its way through a block of runs, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Scan, Tracks, of_runs, scan_of_run
from trackbench.driving.drive import Delivery, DriveStep
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.remote import start_stepper
from trackbench.driving.steppers import Stepper
from trackbench.metrics.ego import EgoScene
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
from trackbench.metrics.traffic.without_truth import (
    UnlabelledScan,
    judged_scan,
    score_without_truth,
    scores_without_truth,
)
from trackbench.results import Failure
from trackbench.runner.start import SecondDrives
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.traffic_sums import TrafficSums
from trackbench.runner.work import BlockRuns, Scene, Work
from trackbench.sensing.detections import HiddenMeasurements
from trackbench.sensing.due import unscored
from trackbench.trackers.answers import NO_TRACK, TrackerFault, require_covariances, tracks_of_run
from trackbench.trackers.multi import MultiObjectTracker
from trackbench.truth.recorded.cycles import stretch_of

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
    tracked: TrackedRun | None = None
    """The recorded run, as metrics get it; None where there are no others than the built-in ones."""
    offset: Array | None = None
    """Of tracks made elsewhere, ``(5, P)``: the run, and the rows of :func:`offset_pairs`."""
    filed: Indices | None = None
    """Of tracks made elsewhere, the numbers of rows, of those within the time of the truth, and of runs without any."""


class HiddenBatch(NamedTuple):
    """The runs that a tracker takes at once: of one scene, or of several whose sensors measure at the same times."""

    pieces: Sequence[BlockRuns]
    measurements: HiddenMeasurements
    """Of the runs of all pieces, one after the other."""

    @property
    def runs(self) -> int:
        """Number of runs of all pieces."""
        return sum(len(piece.runs) for piece in self.pieces)


class SceneRuns(NamedTuple):
    """The runs of one scene in a batch."""

    piece: BlockRuns
    scene: Scene
    first: int
    """Number of its first run in the batch."""


class HiddenRun(TrackerRun[Tracks]):
    """One tracker; each is scored alone, when it has taken all scans.

    Args:
        work: what all blocks share.
        batch: the runs, and their detections.
        name: of the tracker.
        second_drives: as of ``TrackerRun``.
    """

    def __init__(self, work: Work, batch: HiddenBatch, name: str, second_drives: SecondDrives | None) -> None:
        scene = work.scenes[batch.pieces[0].scene]
        self._batch, self._hidden = batch, batch.measurements
        time, scans = scene.truth.time[scene.due.steps], self._hidden.scans
        super().__init__(work, batch.pieces[0], name, time, scans, second_drives)
        firsts = np.cumsum([0, *(len(piece.runs) for piece in batch.pieces)]).tolist()
        scenes = [work.scenes[piece.scene] for piece in batch.pieces]
        self._parts = list(map(SceneRuns, batch.pieces, scenes, firsts))
        self._tracks_at: list[Tracks] = []
        self._taken: list[tuple[int, Tracks, int]] = []
        self._predicted_runs = [
            part.first + run
            for part in self._parts
            for run in range(len(part.piece.runs))
            if not part.scene.truth.known or run == work.recorded_in(part.piece)
        ]
        self._predicted: dict[int, dict[int, Tracks]] = {run: {} for run in self._predicted_runs}
        self._seconds, self._timed, self._untimed = 0.0, 0, int(UNTIMED * len(scans))

    @property
    def pieces(self) -> Sequence[BlockRuns]:
        """Of the batch."""
        return self._batch.pieces

    def _start(self) -> Stepper:
        work = self._work
        prepare = partial(replace, **work.tracker_options)
        options = work.isolation, True, work.sensors
        return start_stepper(work.driven(self.name), work.folder, self._batch.runs, prepare, *options)

    def _arguments(self, delivery: Delivery) -> tuple[Scan, Indices] | tuple[Scan]:
        """With the objects that each detection and the second part of a merged one stem from, where it wants them."""
        if not getattr(self.tracker, "wants_origins", False):
            return (delivery.scan,)
        origins = np.stack([each[delivery.number or 0] for each in (self._hidden.origins, self._hidden.merged)])
        return delivery.scan, origins if delivery.read and delivery.number is not None else origins[:, :0]

    def _require_finite(self) -> None:
        """Fail where a built-in tracker, whose answers are not checked step by step, has a track that is not finite."""
        for instant, tracks in enumerate(self._tracks_at):
            there = tracks.ids != NO_TRACK
            total = tracks.mean.sum(axis=0) + tracks.covariance.sum(axis=(0, 1))
            if self.failure is None and not np.isfinite(total[there]).all():
                try:
                    require_covariances(tracks.ids[there], tracks.mean[:, there], tracks.covariance[:, :, there])
                except TrackerFault as error:
                    self.fail(fault_of(error), instant, None)

    def close(self) -> list[TrafficScores] | Failure:
        """What it left behind of each piece, once the context is left."""
        if self.failure is None:
            self._require_finite()
        return self._scored() if self.failure is None else self.failure

    def _take(self, step: DriveStep[Tracks]) -> None:
        if self._untimed:
            self._untimed -= 1
        else:
            self._seconds += step.seconds
            self._timed += 1
        if step.read and step.number is not None:
            self._taken.append((step.instant, step.answer, step.number))
            if isinstance(self.tracker, MultiObjectTracker) and step.scan.arrival_time == step.scan.time:
                for run in self._predicted_runs:
                    self._predicted[run][step.number] = self.tracker.predicted(self.state, run)
        if step.last:
            self._tracks_at.append(step.answer)
            self._note_spread(step.instant, step.answer)

    def _note_spread(self, instant: int, tracks: Tracks) -> None:
        """Note the mean position of the tracks of each run."""
        if self.spread is None:
            return
        there = tracks.ids != NO_TRACK
        count = there.sum(axis=0)
        mean = np.where(there, tracks.mean[:2], 0.0).sum(axis=1) / np.maximum(count, 1)
        self.spread.take(instant, mean[:, None], (count > 0)[None])

    def _scored(self) -> list[TrafficScores]:
        taken = self._associations() if self._parts[0].scene.truth.known else None
        histories = self._histories()
        return [self._scored_part(part, histories, taken) for part in self._parts]

    def _scored_part(
        self,
        part: SceneRuns,
        histories: Callable[[SceneRuns, int], tuple[TruthHistory, TrackHistory]],
        taken: Associations | None,
    ) -> TrafficScores:
        piece, scene = part.piece, part.scene
        with_truth, count = scene.truth.known, len(piece.runs)
        share = count / self._batch.runs
        outcome = TrafficScores(TrafficSums(), np.zeros(count), share * self._seconds, self._timed * count)
        summing = accumulators([item for item in self._work.metrics if with_truth or item.without_truth])
        options = TrafficScoreOptions(self._work.cutoff or 5.0)
        ends, counted = self._stretches()
        scope = TrackScope(self.name, len(counted) if ends else count, options)
        sums = {name: accumulator.init(scope) for name, accumulator in summing.items()}
        bodies = EgoScene.of(scene.truth, scene.due.steps)
        for run in range(count):
            truth, history = histories(part, run)
            own = None if taken is None else _associations_of(taken, part.first + run, len(scene.truth.ids))
            outside, elsewhere = None, scene.truth.unscored
            if with_truth:
                if elsewhere is not None:
                    # A track is on an object up to half of the cutoff.
                    x, y = history.mean[:2]
                    outside = unscored(scene.truth, scene.due.steps, x, y, margin=options.cutoff / 2)
                    outside |= elsewhere.others
                scores = score_run(truth, history, options, own, outside, ends)
                if elsewhere is not None and elsewhere.others:
                    scores = scores.without_false_tracks()
            else:
                scores = self._scored_without_truth(run, ends)
            tracked = TrackedRun(truth, history, own, scores, outside, bodies)
            pieces = in_stretches(tracked, ends) if ends else [tracked]
            for stretch in [pieces[number] for number in counted] if ends else pieces:
                sums = {name: item.update(sums[name], stretch) for name, item in summing.items()}
            number, recorded = self._work.number(piece.scene, piece.runs.start + run), self._work.recorded_in(piece)
            outcome.sums.add(number, scores, recorded=run == recorded)
            outcome.reused_ids[run] = reused_ids(history, self._time, options.cutoff)
            if piece.runs.start + run == self._work.recorded_run:
                outcome.recorded = history
            if run == recorded:
                outcome.taken = self._detections_taken(part.first + run)
                outcome.predicted = self._predicted[part.first + run]
                outcome.tracked = tracked if len(summing) > 1 else None
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
        return scores_without_truth(score_without_truth(judged))._replace(until=until)

    def _truth_of(self, part: SceneRuns, run: int) -> TruthHistory:
        """The truth at the instants, in a run counted from the first of the piece."""
        number, due = part.piece.runs.start + run, part.scene.due
        state = part.scene.scored.state_of_run(number)[:, due.steps]
        return TruthHistory(self._time, state, of_runs(due.status, range(number, number + 1))[..., 0])

    def _histories(self) -> Callable[[SceneRuns, int], tuple[TruthHistory, TrackHistory]]:
        """A function that gives the truth and the tracks of a run."""
        tracks = _stacked(self._tracks_at)
        return lambda part, run: (self._truth_of(part, run), _of_run(tracks, part.first + run))

    def _associations(self) -> Associations | None:
        """Which detection each track took in every run: arrays ``(scans, ..., runs)``; None where it does not say, or
        where nothing says of which object a detection is."""
        if not self._taken or self._parts[0].scene.unlabelled:
            return None
        if any(tracks.used is None and tracks.ids.size for _, tracks, _ in self._taken):
            return None
        runs, objects = self._batch.runs, max(len(part.scene.truth.ids) for part in self._parts)
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
        begun = self._delivery is not None
        if begun and fault.kind == "raised" and not any(len(tracks.ids) for tracks in self._tracks_at):
            return TrackFault(f"{fault.cause} ({NO_TRACKS_YET})", fault.kind, fault.place, fault.member)
        return fault

    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        return None, member


def reused_ids(tracks: TrackHistory, time: Array, cutoff: float) -> int:
    """Count the ids of a run that come back elsewhere after an instant without them; ``time`` is ``(T,)`` s.

    A track that was not reported for a while comes back where its velocity takes it: within ``cutoff``, m, and four of
    the standard deviations that it stated.
    """
    instant, column = np.nonzero(tracks.ids != NO_TRACK)
    order = np.lexsort((instant, tracks.ids[instant, column]))
    instant, column = instant[order], column[order]
    ids, state = tracks.ids[instant, column], tracks.mean[:, instant, column]
    variance = np.einsum("iik->ik", np.nan_to_num(tracks.covariance[:, :, instant, column]))
    last = np.flatnonzero((np.diff(ids) == 0) & (np.diff(instant) > 1))
    elapsed = time[instant[last + 1]] - time[instant[last]]
    away = state[:2, last + 1] - state[:2, last] - elapsed * np.nan_to_num(state[2:, last])
    spread = np.sqrt((variance[:2, last] + elapsed**2 * variance[2:, last]).max(axis=0, initial=0.0))
    return int(np.sum(np.hypot(*away) > cutoff + 4.0 * spread))


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
    there = ids != NO_TRACK
    most = int(there.sum(axis=1).max(initial=0))
    if (there[:, 1:] <= there[:, :-1]).all():
        own = Tracks(*(None if part is None else part[..., :most, run].copy() for part in tracks))  # type: ignore[arg-type]
        return TrackHistory(own.ids, own.mean, own.covariance, own.existence)
    order = np.argsort(~there, axis=1, kind="stable")[:, :most]
    rows = np.arange(len(ids))[:, None]
    existence = None if tracks.existence is None else tracks.existence[rows, order, run]
    return TrackHistory(
        ids[rows, order], tracks.mean[:, rows, order, run], tracks.covariance[:, :, rows, order, run], existence
    )


def _associations_of(taken: Associations, run: int, objects: int) -> Associations:
    merged, detected = None if taken.merged is None else taken.merged[..., run], taken.detected[:, :objects, run]
    return Associations(taken.instant, taken.ids[..., run], taken.origin[..., run], detected, merged)

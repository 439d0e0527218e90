"""Scorer of the tracks of one tracker, run by run, after the last scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Tracks, Truth, of_runs, scan_of_run
from trackbench.driving.drive import Delivery
from trackbench.metrics.built_in.step_time import StepTime
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.evaluate import MetricSums, accumulators
from trackbench.metrics.protocol import Metric, Scope
from trackbench.metrics.traffic.assignment import (
    NO_DETECTION,
    Associations,
    TrackHistory,
    TrafficScoreOptions,
    TruthHistory,
)
from trackbench.metrics.traffic.run import RunScores, TrackedRun, in_stretches, score_run
from trackbench.metrics.traffic.table import TRACKS
from trackbench.metrics.traffic.timeline import TIMELINE, Timeline
from trackbench.metrics.traffic.without_truth import (
    UnlabelledScan,
    judged_scan,
    run_scores_of,
    score_without_truth,
)
from trackbench.sensing.due import Due, unscored
from trackbench.sensing.scans import IdealSensor, Measurements
from trackbench.trackers.answers import NO_TRACK, tracks_of_run

#: Share of the scans, from the first on, whose computing time does not count: a tracker may still load what it needs.
UNTIMED = 0.1


class SceneRuns(NamedTuple):
    """Runs of one scene that a tracker takes at once, perhaps with runs of other scenes."""

    truth: Truth
    scored: Truth
    """Motion of the point of each body that tracks are compared with."""
    due: Due
    sensors: Sequence[IdealSensor]
    runs: range
    """Numbers of these runs, counted within the scene."""
    first: int
    """Number of the first of these runs, counted among the runs of all scenes that the tracker takes at once."""
    number: int
    """Number of the first of these runs, counted among the runs of the whole scenario."""
    recorded: int | None
    """Index of the run whose tracks are kept, counted from the first of these runs; None if that run is not among these
    runs."""
    shown: bool
    """Whether the recording displays this scene."""

    @property
    def unlabelled(self) -> bool:
        """Whether the detections of some sensor have no known origin."""
        return any(sensor.detections is not None for sensor in self.sensors)

    def truth_at(self, time: Array, run: int) -> TruthHistory:
        """Return the truth in a run at the instants ``time`` ``(T,)`` s; ``run``: index of the run within ``runs``."""
        number = self.runs.start + run
        state = self.scored.state_of_run(number)[:, self.due.steps]
        return TruthHistory(time, state, of_runs(self.due.status, range(number, number + 1))[..., 0])


@dataclass
class RecordedTracks:
    """Tracks of one tracker in the recorded run, the run whose tracks are kept and shown."""

    history: TrackHistory
    taken: Indices | None = None
    """``(rows, 3)`` index of the scan, id of the track, and index of the detection that the track took; None unless the
    recording shows the run's scene."""
    predicted: dict[int, Tracks] = field(default_factory=dict)
    """Tracks that a built-in tracker predicts for each scan, by index of the scan."""
    tracked: TrackedRun | None = None
    """Truth, tracks and scores of the run, as metrics get them; None if all metrics are built in."""


class ScoredTracks(NamedTuple):
    """Sums of scores over the runs of one scene, with the tracks of the recorded run."""

    sums: MetricSums
    recorded: RecordedTracks | None


#: Returns the truth and the tracks of a run, which is counted from the first one of its scene.
Histories = Callable[[SceneRuns, int], tuple[TruthHistory, TrackHistory]]


class TrackScorer:
    """Scorer of the tracks of one tracker; ``close`` returns the sums of each scene at the end.

    Args:
        tracker: name of the tracker.
        time: ``(instants,)`` time of each instant, s.
        measurements: measurements of the runs of all scenes, one after the other.
        scenes: the runs of each scene.
        metrics: metrics to compute.
        options: criteria by which a track is scored.
        ends: instants before which the stretches of a log end; empty where the log is not cut.
        counted: indices of the stretches that are scored.
    """

    def __init__(
        self,
        tracker: str,
        time: Array,
        measurements: Measurements,
        scenes: Sequence[SceneRuns],
        metrics: Sequence[Metric],
        options: TrafficScoreOptions,
        ends: Sequence[int] = (),
        counted: Sequence[int] = (),
    ) -> None:
        self._tracker, self._time, self._measurements, self._scenes = tracker, time, measurements, scenes
        self._metrics, self._options, self._ends, self._counted = metrics, options, ends, counted
        self.tracks_at: list[Tracks] = []
        """Tracks that the tracker gave in all runs, one element for each instant."""
        self._taken: list[tuple[int, Tracks, int]] = []
        with_prediction = [
            scene.first + run
            for scene in scenes
            for run in range(len(scene.runs))
            if not scene.truth.known or (scene.shown and run == scene.recorded)
        ]
        self._predicted: dict[int, dict[int, Tracks]] = {run: {} for run in with_prediction}
        self._seconds, self._timed, self._untimed = 0.0, 0, int(UNTIMED * len(measurements.scans))

    def take(
        self, delivery: Delivery, answer: Tracks, seconds: float, predicted: Callable[[int], Tracks] | None = None
    ) -> None:
        """Add the tracker's answer to a scan; call it for each scan in order.

        Args:
            delivery: the scan.
            answer: the tracks of all runs.
            seconds: time that the step took, s.
            predicted: returns the tracks that a built-in tracker predicts for the scan in a run; None for a plug-in.
        """
        if self._untimed:
            self._untimed -= 1
        else:
            self._seconds += seconds
            self._timed += 1
        if delivery.read and delivery.number is not None:
            self._taken.append((delivery.instant, answer, delivery.number))
            if predicted is not None:
                for run, tracks_before in self._predicted.items():
                    tracks_before[delivery.number] = predicted(run)
        if delivery.last:
            self.tracks_at.append(answer)

    def close(self, histories: Histories | None = None) -> list[ScoredTracks]:
        """Return sums and recorded tracks of each scene, from ``histories`` or, if None, from answers to ``take``."""
        taken = self._associations() if self._scenes[0].truth.known else None
        histories = histories or self._histories()
        return [self._scored_scene(scene, histories, taken) for scene in self._scenes]

    def _scored_scene(self, scene: SceneRuns, histories: Histories, taken: Associations | None) -> ScoredTracks:
        with_truth, count, recorded = scene.truth.known, len(scene.runs), None
        summing = accumulators([item for item in self._metrics if with_truth or "truth" not in item.needs])
        bodies = EgoScene.of(scene.truth, scene.due.steps)
        scope = Scope(self._tracker, len(self._counted) if self._ends else count, bodies, self._options)
        sums, timeline = {name: item.init(scope) for name, item in summing.items()}, Timeline()
        seconds = self._seconds / sum(len(other.runs) for other in self._scenes)
        for run in range(count):
            truth, history = histories(scene, run)
            associations = None if taken is None else _associations_of(taken, scene.first + run, len(scene.truth.ids))
            outside, unscored_places = None, scene.truth.unscored
            if with_truth:
                if unscored_places is not None:
                    # A track is on an object up to half of the cutoff.
                    x, y = history.mean[:2]
                    outside = unscored(scene.truth, scene.due.steps, x, y, margin=self._options.cutoff / 2)
                    outside |= unscored_places.others
                scores = score_run(truth, history, self._options, associations, outside, self._ends)
                if unscored_places is not None and unscored_places.others:
                    scores = scores.without_false_tracks()
            else:
                scores = self._scored_without_truth(scene, run)
            tracked = TrackedRun(truth, history, associations, scores, outside, bodies, seconds, self._timed)
            pieces = in_stretches(tracked, self._ends) if self._ends else [tracked]
            for stretch in [pieces[number] for number in self._counted] if self._ends else pieces:
                sums = {name: item.update(sums[name], stretch) for name, item in summing.items()}
            shown = scene.shown and run == scene.recorded
            timeline.add(scene.number + run, scores, recorded=shown)
            timeline.reused_ids += reused_ids(history, self._time, self._options.cutoff)
            if run == scene.recorded:
                recorded = RecordedTracks(history)
            if recorded is not None and shown:
                recorded.taken = self._detections_taken(scene.first + run)
                recorded.predicted = self._predicted[scene.first + run]
                recorded.tracked = tracked if summing.keys() - {TRACKS.name, StepTime.name} else None
        closed = {name: item.close(sums[name]) for name, item in summing.items()}
        return ScoredTracks({**closed, TIMELINE: timeline}, recorded)

    def _scored_without_truth(self, scene: SceneRuns, run: int) -> RunScores:
        judged = self._judged_scans(scene, run)
        taken = np.searchsorted([instant for instant, _, _ in self._taken], self._ends).tolist()
        until = tuple(score_without_truth(judged[:number]) if number else {} for number in taken)
        return run_scores_of(score_without_truth(judged))._replace(until=until)

    def _histories(self) -> Histories:
        tracks = _stacked(self.tracks_at)
        return lambda scene, run: (scene.truth_at(self._time, run), _of_run(tracks, scene.first + run))

    def _associations(self) -> Associations | None:
        if not self._taken or self._scenes[0].unlabelled:
            return None
        if any(tracks.used is None and tracks.ids.size for _, tracks, _ in self._taken):
            return None
        runs = sum(len(scene.runs) for scene in self._scenes)
        objects = max(len(scene.truth.ids) for scene in self._scenes)
        shape = (len(self._taken), max(len(tracks.ids) for _, tracks, _ in self._taken), runs)
        ids, origin = np.full(shape, NO_TRACK), np.full(shape, NO_DETECTION)
        merged, detected = np.full(shape, NO_TRACK), np.zeros((shape[0], objects, runs), dtype=bool)
        for row, (_, tracks, number) in enumerate(self._taken):
            origins, second = self._measurements.origins[number], self._measurements.merged[number]
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

    def _judged_scans(self, scene: SceneRuns, run: int) -> list[UnlabelledScan]:
        sensors = {sensor.name: sensor.config for sensor in scene.sensors}
        judged = []
        for _, tracks, number in self._taken:
            scan = scan_of_run(self._measurements.scans[number], run)
            predicted = self._predicted[run].get(number)
            judged.append(judged_scan(scan, sensors[scan.sensor], predicted, tracks_of_run(tracks, run)))
        return judged

    def _detections_taken(self, run: int) -> Indices:
        rows = [
            (number, tracks.ids[column, run], tracks.used[column, run])
            for _, tracks, number in self._taken
            if tracks.used is not None
            for column in np.flatnonzero(tracks.used[:, run] >= 0)
        ]
        return np.array(rows, dtype=np.intp).reshape(-1, 3)


def reused_ids(tracks: TrackHistory, time: Array, cutoff: float) -> int:
    """Count the ids that a tracker used for a second track elsewhere; ``time`` is ``(T,)`` s.

    A track that was not reported for a while is predicted with its last velocity. If the id returns farther from there
    than ``cutoff``, m, and four stated standard deviations of the track, the id was used again.
    """
    instant, column = np.nonzero(tracks.ids != NO_TRACK)
    order = np.argsort(tracks.ids[instant, column], kind="stable")
    instant, column = instant[order], column[order]
    ids = tracks.ids[instant, column]
    last = np.flatnonzero((np.diff(ids) == 0) & (np.diff(instant) > 1))
    at, after = (instant[last], column[last]), (instant[last + 1], column[last + 1])
    elapsed, state = time[after[0]] - time[at[0]], tracks.mean[:, *at]
    variance = np.einsum("iik->ik", np.nan_to_num(tracks.covariance[:, :, *at]))
    away = tracks.mean[:2, *after] - state[:2] - elapsed * np.nan_to_num(state[2:])
    spread = np.sqrt((variance[:2] + elapsed**2 * variance[2:]).max(axis=0, initial=0.0))
    return int(np.sum(np.hypot(*away) > cutoff + 4.0 * spread))


def _stacked(instants: Sequence[Tracks]) -> Tracks:
    """Stack the tracks of all instants in arrays ``(runs, ..., T, K)``, so that each run is contiguous."""
    most = max(len(tracks.ids) for tracks in instants)
    runs, shape = instants[0].ids.shape[1], (len(instants), most)
    ids = np.full((runs, *shape), NO_TRACK)
    mean, covariance = np.full((runs, 4, *shape), np.nan), np.full((runs, 4, 4, *shape), np.nan)
    has_existence = any(tracks.existence is not None for tracks in instants)
    existence = np.full((runs, *shape), np.nan) if has_existence else None
    for row, tracks in enumerate(instants):
        for whole, part in zip((ids, mean, covariance, existence), tracks[:4], strict=True):
            if whole is not None and part is not None:
                whole[..., row, : len(tracks.ids)] = np.moveaxis(part, -1, 0)
    return Tracks(ids, mean, covariance, existence)


def _of_run(tracks: Tracks, run: int) -> TrackHistory:
    ids = tracks.ids[run]
    there = ids != NO_TRACK
    most = int(there.sum(axis=1).max(initial=0))
    if (there[:, 1:] <= there[:, :-1]).all():
        columns = Tracks(*(None if part is None else part[run, ..., :most].copy() for part in tracks))  # type: ignore[arg-type]
        return TrackHistory(columns.ids, columns.mean, columns.covariance, columns.existence)
    order = np.argsort(~there, axis=1, kind="stable")[:, :most]
    rows = np.arange(len(ids))[:, None]
    existence = None if tracks.existence is None else tracks.existence[run, rows, order]
    mean, covariance = tracks.mean[run], tracks.covariance[run]
    return TrackHistory(ids[rows, order], mean[:, rows, order], covariance[:, :, rows, order], existence)


def _associations_of(taken: Associations, run: int, objects: int) -> Associations:
    merged, detected = None if taken.merged is None else taken.merged[..., run], taken.detected[:, :objects, run]
    return Associations(taken.instant, taken.ids[..., run], taken.origin[..., run], detected, merged)

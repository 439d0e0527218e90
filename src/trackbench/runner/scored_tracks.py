"""Scoring of a multi-object tracker's tracks with hidden identities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from trackbench.base.types import Tracks
from trackbench.driving.drive import Delivery
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.metrics.protocol import Fault
from trackbench.metrics.traffic.scorer import SceneRuns, TrackScorer
from trackbench.runner.external_run import ExternalHistories, ExternalRows
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import Measurements
from trackbench.trackers.answers import NO_TRACK, TrackerFault, require_covariances
from trackbench.truth.recorded.cycles import stretch_of

NO_TRACKS_YET = "it gave no tracks; does it follow one object only? With hidden identities a scan has detections of all"


class TrackScoring:
    """Scoring of a tracker's tracks, run by run after the last scan; tracks of another program need no scans."""

    def __init__(self, work: Work, pieces: Sequence[BlockRuns], name: str, measurements: Measurements) -> None:
        self._work, self._name, self._piece, self._measurements = work, name, pieces[0], measurements
        scene = work.scenes[self._piece.scene]
        self._time = scene.truth.time[scene.due.steps]
        assert work.track_score is not None
        ends, counted = self._stretches()
        self._scorer = TrackScorer(
            name, self._time, measurements, _scene_runs(work, pieces), work.metrics, work.track_score, ends, counted
        )

    def take(
        self, delivery: Delivery, answer: Tracks, seconds: float, predicted: Callable[[int], Tracks] | None = None
    ) -> None:
        """Add the tracker's answer to a scan; ``predicted`` returns a built-in tracker's predicted tracks in a run."""
        self._scorer.take(delivery, answer, seconds, predicted)

    def close(self) -> list[Outcome]:
        """Score all tracks, and return the tracker's outcome (sums of scores) in each block of runs.

        Raises:
            Fault: a track of a built-in tracker, whose answers are not checked step by step, is not finite.
        """
        if self._name in self._work.external_tracks:
            assert self._work.track_score is not None
            rows = ExternalRows(self._work, self._piece, self._name, self._measurements)
            histories = ExternalHistories(rows, self._work.track_score.cutoff)
            (scored,) = self._scorer.close(histories.of_run)
            return [Outcome(*scored, offset=histories.offsets, external_rows=histories.counts)]
        for instant, tracks in enumerate(self._scorer.tracks_at):
            exists = tracks.ids != NO_TRACK
            total = tracks.mean.sum(axis=0) + tracks.covariance.sum(axis=(0, 1))
            if not np.isfinite(total[exists]).all():
                try:
                    require_covariances(tracks.ids[exists], tracks.mean[:, exists], tracks.covariance[:, :, exists])
                except TrackerFault as error:
                    raise Fault(fault_of(error).cause, instant, None) from error
        return [Outcome(*scored) for scored in self._scorer.close()]

    def hint(self, fault: TrackFault) -> str:
        """Return the likely cause of an error raised before the first track; empty where no cause is likely."""
        none_yet = not any(len(tracks.ids) for tracks in self._scorer.tracks_at)
        return NO_TRACKS_YET if none_yet and fault.kind == "raised" else ""

    def place(self, member: int) -> tuple[None, int]:
        """Return None for the object, as a member is a whole run, and the index of the member's run in the batch."""
        return None, member

    def _stretches(self) -> tuple[list[int], list[int]]:
        """Return, for a log cut into stretches of time, each stretch's end index and the scored stretches' numbers.

        Both lists are empty for a log that is not cut.
        """
        if not self._work.stretches:
            return [], []
        number = stretch_of(self._time, self._work.stretches)
        ends = np.searchsorted(number, np.arange(self._work.stretches), side="right").tolist()
        return ends, [stretch for scene, stretch in self._work.counted_stretches if scene == self._piece.scene]


def _scene_runs(work: Work, pieces: Sequence[BlockRuns]) -> list[SceneRuns]:
    scenes, first = list[SceneRuns](), 0
    for piece in pieces:
        scene, recorded = work.scenes[piece.scene], work.recorded_run - piece.runs.start
        scenes.append(
            SceneRuns(
                scene.truth,
                scene.scored,
                scene.due,
                scene.sensors,
                piece.runs,
                first,
                work.number(piece.scene, piece.runs.start),
                recorded if recorded in range(len(piece.runs)) else None,
                piece.scene == work.recorded_scene,
            )
        )
        first += len(piece.runs)
    return scenes

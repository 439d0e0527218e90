"""A tracker of several objects with hidden identities on its way through a block of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Indices, Scan, Tracks
from trackbench.driving.drive import Delivery, DriveStep
from trackbench.driving.faults import TrackFault, fault_of
from trackbench.driving.remote import start_stepper
from trackbench.driving.steppers import Stepper
from trackbench.metrics.traffic import TrafficScoreOptions
from trackbench.metrics.traffic.scorer import SceneRuns, TrackScorer
from trackbench.results import Failure
from trackbench.runner.recorded import Outcome
from trackbench.runner.start import SecondDrives
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.detections import HiddenMeasurements
from trackbench.trackers.answers import NO_TRACK, TrackerFault, require_covariances
from trackbench.trackers.multi import MultiObjectTracker
from trackbench.truth.recorded.cycles import stretch_of

NO_TRACKS_YET = "it had given no tracks; is it of one object? With hidden identities a scan has detections of all"


class HiddenBatch(NamedTuple):
    """The runs that a tracker takes at once: of one scene, or of several whose sensors measure at the same times."""

    pieces: Sequence[BlockRuns]
    measurements: HiddenMeasurements
    """Of the runs of all pieces, one after the other."""

    @property
    def runs(self) -> int:
        """Number of runs of all pieces."""
        return sum(len(piece.runs) for piece in self.pieces)


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
        options = TrafficScoreOptions(work.cutoff or 5.0, work.switch_costs)
        self.scorer = TrackScorer(
            name, time, self._hidden, self._scene_runs(), work.metrics, options, *self._stretches()
        )

    @property
    def pieces(self) -> Sequence[BlockRuns]:
        """Of the batch."""
        return self._batch.pieces

    def _scene_runs(self) -> list[SceneRuns]:
        work, scenes, first = self._work, list[SceneRuns](), 0
        for piece in self.pieces:
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

    def _stretches(self) -> tuple[list[int], list[int]]:
        """The instants before which the stretches of a log end, and the numbers of those that count."""
        if not self._work.stretches:
            return [], []
        number = stretch_of(self._time, self._work.stretches)
        ends = np.searchsorted(number, np.arange(self._work.stretches), side="right").tolist()
        return ends, [stretch for scene, stretch in self._work.counted_stretches if scene == self._piece.scene]

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
        for instant, tracks in enumerate(self.scorer.tracks_at):
            there = tracks.ids != NO_TRACK
            total = tracks.mean.sum(axis=0) + tracks.covariance.sum(axis=(0, 1))
            if self.failure is None and not np.isfinite(total[there]).all():
                try:
                    require_covariances(tracks.ids[there], tracks.mean[:, there], tracks.covariance[:, :, there])
                except TrackerFault as error:
                    self.fail(fault_of(error), instant, None)

    def close(self) -> list[Outcome] | Failure:
        """What it left behind of each piece, once the context is left."""
        if self.failure is None:
            self._require_finite()
        return self.failure or [Outcome(*scored) for scored in self.scorer.close()]

    def _score(self, step: DriveStep[Tracks]) -> None:
        tells = isinstance(self.tracker, MultiObjectTracker) and step.scan.arrival_time == step.scan.time
        self.scorer.take(step, partial(self.tracker.predicted, self.state) if tells else None)

    def _take(self, step: DriveStep[Tracks]) -> None:
        if step.last:
            self._note_spread(step.instant, step.answer)

    def _note_spread(self, instant: int, tracks: Tracks) -> None:
        """Note the mean position of the tracks of each run."""
        if self.spread is None:
            return
        there = tracks.ids != NO_TRACK
        count = there.sum(axis=0)
        mean = np.where(there, tracks.mean[:2], 0.0).sum(axis=1) / np.maximum(count, 1)
        self.spread.take(instant, mean[:, None], (count > 0)[None])

    def _explained(self, fault: TrackFault) -> TrackFault:
        """An error before the first track may be that of a tracker of one object."""
        begun = self._delivery is not None
        if begun and fault.kind == "raised" and not any(len(tracks.ids) for tracks in self.scorer.tracks_at):
            return TrackFault(f"{fault.cause} ({NO_TRACKS_YET})", fault.kind, fault.place, fault.member)
        return fault

    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        return None, member

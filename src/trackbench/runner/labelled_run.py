"""A tracker of single objects with known identities on its way through a block of runs, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.driving.drive import DriveStep, scans_read
from trackbench.driving.faults import TrackFault
from trackbench.driving.steppers import Direct, Stepper
from trackbench.engine.choice import compute_by
from trackbench.metrics import Scorer
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.ego import EgoScene
from trackbench.results import Failure
from trackbench.runner.recorded import ModeSums, Outcome, RecordedEstimates, RecordedInstant
from trackbench.runner.start import SecondDrives, stepper_of
from trackbench.runner.targets import Targets
from trackbench.runner.tracker_run import TrackerRun
from trackbench.runner.work import BlockRuns, Work

if TYPE_CHECKING:
    from trackbench.runner.filter_sequence import SequenceResult

#: Errors that come of an array with fewer axes than expected.
OF_SHAPES = ("AxisError", "IndexError", "ValueError: not enough values to unpack")
NO_ANSWER_YET = "is it of several objects? Those need sensing: {identities: hidden}"
#: Instants that are taken by one sequence of calls, at most.
INSTANTS = 64


class LabelledRun(TrackerRun[Estimate | None]):
    """One tracker of single objects.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        name: of the tracker.
        targets: what trackers are held against.
        second_drives: as of ``TrackerRun``.
        observe: called with the estimates of the recorded run at each instant, if it is in the block.
    """

    def __init__(
        self,
        work: Work,
        piece: BlockRuns,
        name: str,
        targets: Targets,
        second_drives: SecondDrives | None,
        observe: Callable[[RecordedInstant], None] | None = None,
    ) -> None:
        config, scene = work.driven(name), work.scenes[piece.scene]
        self._config, self._scene, self._kept = config, scene, work.recorded_in(piece)
        self._target, self._observe = targets.of(config), observe
        super().__init__(work, piece, name, self._target.time, targets.scans, second_drives)
        self.scorer = Scorer(
            self._target,
            targets.conditions(config),
            {sensor.name: len(sensor.steps) for sensor in scene.sensors},
            tracker=name,
            single=work.over_stretches,
            metrics=work.metrics,
            compute=compute_by(work.engine_here),
            measured=partial(targets.measured, config),
            bodies=EgoScene.of(scene.truth, scene.instants()),
        )
        objects, instants = len(scene.truth.ids), len(self._target.time)
        self._modes: ModeSums | None = None
        self._has_answered = False
        self._step_by_step_until = 0
        self._recorded: RecordedEstimates | None = None
        if self._kept is not None:
            self._recorded = RecordedEstimates(
                np.full((4, instants, objects), np.nan),
                np.full((4, 4, instants, objects), np.nan),
                self._target.due[..., self._kept],
                {
                    sensor.name: [np.full(objects, np.nan)] * len(sensor.steps)
                    for sensor in scene.sensors
                    if len(sensor.steps)
                },
            )
            counts = dict.fromkeys(self._recorded.nis, 0)
            self._of_sensor: list[int] = []
            for scan in self._scans:
                self._of_sensor.append(counts[scan.sensor])
                counts[scan.sensor] += 1

    def close(self) -> Outcome | Failure:
        """What it left behind, once the context is left."""
        if self.failure is not None:
            if self._observe is not None and self._recorded is not None:
                objects = self._recorded.mean.shape[-1]
                none = Gaussian(np.full((4, objects), np.nan), np.full((4, 4, objects), np.nan))
                self._observe(RecordedInstant(self.failure.step or 0, {self.name: none}))
            return self.failure
        outcome = Outcome(self.scorer.close(), self._recorded, self._modes)
        if outcome.scores.due.sum() > 0 and not outcome.scores.given:
            self.fail(TrackFault("it gave no estimate at all", "answer"), len(self._time) - 1, None)
        return self.failure or outcome

    def _start(self) -> Stepper:
        scans = scans_read(self._scans, self._config.sensors_used)
        return stepper_of(self._work, self._piece, self._config, scans)

    def _taken_at_once(self, instant: int) -> int:
        """By one sequence of calls, which scores them too; none where they have to be taken step by step."""
        if self._work.engine_here == "numpy" or instant < self._step_by_step_until:
            return 0
        if not isinstance(self._stepper, Direct):
            return 0
        if self.state is None or self.scorer.waits:
            return 0
        from trackbench.runner.filter_sequence import through

        instants = self._deliveries[instant : instant + INSTANTS]
        scans = [[delivery.scan for delivery in group] for group in instants]
        taken = through(self.tracker, self.state, scans, self.scorer, instant, self._kept)
        if taken is None:
            # Most of the time it is because of a single instant.
            self._step_by_step_until = instant + self.scorer.chunk
            return 0
        self._keep_sequence(taken, instant, [delivery.number for group in instants for delivery in group])
        self.state = taken.sequence.state()
        return taken.steps[-1].instant + 1

    def _keep_sequence(self, taken: SequenceResult, first: int, numbers: Sequence[int | None]) -> None:
        """Keep what the recorded run and the modes have of a sequence; ``numbers``: of the scans of its steps."""
        members = slice(self._kept, None, len(self._piece.runs))
        for place, (step, number) in enumerate(zip(taken.steps, numbers, strict=False)):
            instant, probability = first + step.instant, taken.probability(place)
            if step.last and probability is not None:
                self._take_modes(instant, probability)
            if taken.recorded is not None and step.last:
                self._keep(instant, *taken.recorded.estimate(place))
            if taken.recorded is not None and number is not None and place in taken.whitened:
                self._keep_nis(number, step.scan, taken.whitened[place][:, members], members)

    def _take(self, step: DriveStep[Estimate | None]) -> None:
        self._has_answered = True
        latest = step.answer or self.scorer.none
        members = slice(self._kept, None, len(self._piece.runs))
        if step.number is not None and self._recorded is not None:
            white = whitened_innovation(latest, members)
            if white is not None:
                self._keep_nis(step.number, step.scan, white, members)
        if not step.last:
            return
        if self.spread is not None:
            due = self._target.due[step.instant]
            self.spread.take(step.instant, latest.mean[:2].reshape(2, *due.shape), due)
        if latest.mode_probabilities is not None:
            self._take_modes(step.instant, latest.mode_probabilities)
        if self._recorded is not None:
            self._keep(step.instant, latest.mean[:, members], latest.covariance[:, :, members])

    def _take_modes(self, instant: int, probability: Array) -> None:
        self._modes = self._modes or ModeSums(len(probability), self._target, self._kept)
        self._modes.take(instant, probability, self._target)

    def _keep(self, instant: int, mean: Array, covariance: Array) -> None:
        """What the recorded run has of estimates ``(4, objects)``."""
        assert self._recorded is not None
        alive = self._target.alive[instant]
        recorded = Gaussian(np.where(alive, mean, np.nan), np.where(alive, covariance, np.nan))
        self._recorded.mean[:, instant], self._recorded.covariance[:, :, instant] = recorded
        if self._observe is not None:
            self._observe(RecordedInstant(instant, {self.name: recorded}))

    def _keep_nis(self, number: int, scan: Scan, white: Array, members: slice) -> None:
        """What it has of the whitened innovations ``(m, objects)`` of a scan."""
        assert self._recorded is not None
        nis = np.where(scan.valid[members], np.einsum("i...,i...->...", white, white), np.nan)
        self._recorded.nis[scan.sensor][self._of_sensor[number]] = nis

    def _explained(self, fault: TrackFault) -> TrackFault:
        """An error at the first scan may be that of a tracker of several objects."""
        if self._has_answered or not fault.cause.startswith(OF_SHAPES):
            return fault
        return TrackFault(f"{fault.cause} ({NO_ANSWER_YET})", fault.kind, fault.place, fault.member)

    def _place(self, member: int | None) -> tuple[str | None, int | None]:
        if member is None:
            return None, None
        object, run = divmod(member, len(self._piece.runs))
        return self._scene.truth.ids[object], run

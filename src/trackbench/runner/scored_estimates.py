"""The estimates of one tracker of single objects: scored, and kept of the recorded run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.driving.drive import Delivery, DriveStep, deliveries
from trackbench.driving.faults import TrackFault
from trackbench.engine.choice import compute_by
from trackbench.metrics import Scorer
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.protocol import Fault
from trackbench.runner.filed_estimates import filed_estimates
from trackbench.runner.recorded import ModeSums, OnRecordedRun, Outcome, RecordedEstimates, RecordedInstant
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.track_steps import TrackState

if TYPE_CHECKING:
    from trackbench.runner.sequence_run import SequenceResult

#: Errors that come of an array with fewer axes than expected.
OF_SHAPES = ("AxisError", "IndexError", "ValueError: not enough values to unpack")
NO_ANSWER_YET = "does it follow several objects? Then write sensing: {identities: hidden}"


class EstimateScoring:
    """Scores what a tracker of single objects says, and keeps its recorded run and its modes.

    Args:
        work: what all blocks share.
        piece: the runs of this block.
        name: of the tracker.
        targets: what trackers are held against.
        observe: called with the estimates of the recorded run at each instant, if it is in the block.
    """

    def __init__(
        self, work: Work, piece: BlockRuns, name: str, targets: Targets, observe: OnRecordedRun | None
    ) -> None:
        self._work, self._measurements = work, targets.measurements
        config, scene = work.trackers[name], work.scenes[piece.scene]
        self._name, self._piece, self._scene, self._kept = name, piece, scene, work.recorded_in(piece)
        self._target, self._observe = targets.of(config), observe
        self._scorer = Scorer(
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
        self._has_answered = False
        self._modes: ModeSums | None = None
        self._recorded: RecordedEstimates | None = None
        if self._kept is not None:
            counts = {sensor.name: len(sensor.steps) for sensor in scene.sensors if len(sensor.steps)}
            self._recorded = RecordedEstimates.empty(self._target, self._kept, counts)
            taken = dict.fromkeys(counts, 0)
            self._of_sensor: list[int] = []
            for scan in targets.scans:
                self._of_sensor.append(taken[scan.sensor])
                taken[scan.sensor] += 1

    @property
    def waits(self) -> bool:
        """Whether something was taken in that is not scored yet."""
        return self._scorer.waits

    @property
    def chunk(self) -> int:
        """The number of instants that are scored together."""
        return self._scorer.chunk

    def take(self, step: DriveStep[Estimate | None], _: object = None) -> None:
        """Score what the tracker says to a scan, and keep what the recorded run and the modes have of it.

        Raises:
            Fault: an estimate cannot be scored, or has more or fewer modes than those before.
        """
        self._has_answered = True
        self._scorer.take(step)
        latest = step.answer or self._scorer.no_estimate
        members = self._members
        if step.number is not None and self._recorded is not None:
            white = whitened_innovation(latest, members)
            if white is not None:
                self._keep_nis(step.number, step.scan, white)
        if not step.last:
            return
        if latest.mode_probabilities is not None:
            self._take_modes(step.instant, latest.mode_probabilities)
        if self._recorded is not None:
            self._keep(step.instant, latest.mean[:, members], latest.covariance[:, :, members])

    def take_sequence(
        self, tracker: FilterTracker, state: TrackState, instants: Sequence[Sequence[Delivery]], first: int
    ) -> tuple[TrackState, int] | None:
        """Take the tracker through instants by one sequence of calls; return its state and how many instants these are.

        Args:
            tracker: the tracker.
            state: its state before them.
            instants: what it is given at each.
            first: the number of the first.

        Returns:
            None where they have to be taken step by step.
        """
        from trackbench.runner.sequence_run import run_sequence

        scans = [[delivery.scan for delivery in group] for group in instants]
        taken = run_sequence(tracker, state, scans, self._scorer, first, self._kept)
        if taken is None:
            return None
        self._keep_sequence(taken, first, [delivery.number for group in instants for delivery in group])
        return taken.sequence.state(), taken.steps[-1].instant + 1

    def close(self) -> list[Outcome]:
        """What the tracker left behind.

        Raises:
            Fault: it gave no estimate where one was due.
            InputError: estimates that were made elsewhere are not of these scans and objects.
        """
        if self._name in self._work.filed:
            self._take_filed()
        outcome = Outcome(self._scorer.close(), self._recorded, self._modes)
        if outcome.scores.due.sum() > 0 and not outcome.scores.given:
            raise Fault("it gave no estimate at all", len(self._target.time) - 1, None)
        return [outcome]

    def _take_filed(self) -> None:
        """Score the estimates of a file."""
        mean, covariance = filed_estimates(self._work, self._piece, self._name, self._measurements)
        given = deliveries(self._measurements.scans, [], self._scene.each_measurement)
        for instant, group in enumerate(given):
            for place, delivery in enumerate(group):
                estimate = Estimate(mean[:, instant].reshape(4, -1), covariance[:, :, instant].reshape(4, 4, -1))
                self.take(DriveStep(instant, *delivery, estimate, math.nan, place == len(group) - 1))

    def failed(self, instant: int) -> None:
        """Tell the observer that there are no estimates from an instant on."""
        if self._observe is not None and self._recorded is not None:
            objects = self._recorded.mean.shape[-1]
            none = Gaussian(np.full((4, objects), np.nan), np.full((4, 4, objects), np.nan))
            self._observe(RecordedInstant(instant, {self._name: none}))

    def hint(self, fault: TrackFault) -> str:
        """What an error at the first scan may come of; empty where nothing speaks for it."""
        return "" if self._has_answered or not fault.cause.startswith(OF_SHAPES) else NO_ANSWER_YET

    def place(self, member: int) -> tuple[str | None, int]:
        """The object, and the run counted from the first of the block, of a member of the batch."""
        object, run = divmod(member, len(self._piece.runs))
        return self._scene.truth.ids[object], run

    @property
    def _members(self) -> slice:
        """Those of the recorded run in the batch."""
        return slice(self._kept, None, len(self._piece.runs))

    def _keep_sequence(self, taken: SequenceResult, first: int, numbers: Sequence[int | None]) -> None:
        """Keep what the recorded run and the modes have of a sequence; ``numbers``: of the scans of its steps."""
        for place, (step, number) in enumerate(zip(taken.steps, numbers, strict=False)):
            instant, probability = first + step.instant, taken.probability(place)
            if step.last and probability is not None:
                self._take_modes(instant, probability)
            if taken.recorded is not None and step.last:
                self._keep(instant, *taken.recorded.estimate(place))
            if taken.recorded is not None and number is not None and step.reads:
                self._keep_nis(number, step.scan, taken.recorded.whitened(place))

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
            self._observe(RecordedInstant(instant, {self._name: recorded}))

    def _keep_nis(self, number: int, scan: Scan, white: Array) -> None:
        """What it has of the whitened innovations ``(m, objects)`` of a scan."""
        assert self._recorded is not None
        nis = np.where(scan.valid[self._members], np.einsum("i...,i...->...", white, white), np.nan)
        self._recorded.nis[scan.sensor][self._of_sensor[number]] = nis

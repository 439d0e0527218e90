"""Scoring of a single-object tracker's estimates, with a copy of those in the run that is kept for plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import chain

import numpy as np

from trackbench.base.types import Array, Estimate, Gaussian, Scan
from trackbench.driving.drive import Delivery, deliveries
from trackbench.driving.faults import TrackFault
from trackbench.engine.choice import compute_by
from trackbench.metrics import Scorer
from trackbench.metrics.consistency import whitened_innovation
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.protocol import Fault
from trackbench.runner.external_run import ExternalRows, external_estimates
from trackbench.runner.recorded import ModeSums, OnRecordedRun, Outcome, RecordedEstimates, RecordedInstant
from trackbench.runner.targets import Targets
from trackbench.runner.work import BlockRuns, Work
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.track_steps import TrackState

#: Starts of the messages of errors that arise from an array with too few axes.
OF_SHAPES = ("AxisError", "IndexError", "ValueError: not enough values to unpack")
NO_ANSWER_YET = "does it follow several objects? Then write sensing: {identities: hidden}"


class EstimateScoring:
    """Scoring of a single-object tracker in one block of runs: sums of scores and modes, and the estimates kept.

    Args:
        work: data shared by all blocks.
        piece: block of runs.
        name: name of the tracker.
        targets: scoring targets of the block's trackers.
        observe: called at each instant with the estimates of the recorded run (kept for plots), if it is in the block.
    """

    def __init__(
        self, work: Work, piece: BlockRuns, name: str, targets: Targets, observe: OnRecordedRun | None
    ) -> None:
        self._work, self._measurements = work, targets.measurements
        config, scene = work.trackers[name], work.scenes[piece.scene]
        self._name, self._piece, self._scene, self._recorded_run = name, piece, scene, work.recorded_in(piece)
        self._target, self._observe = targets.of(config), observe
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
        self._has_answered = False
        self._modes: ModeSums | None = None
        self._recorded: RecordedEstimates | None = None
        if self._recorded_run is not None:
            counts = {sensor.name: len(sensor.steps) for sensor in scene.sensors if len(sensor.steps)}
            self._recorded = RecordedEstimates.empty(self._target, self._recorded_run, counts)
            taken = dict.fromkeys(counts, 0)
            self._of_sensor: list[int] = []
            for scan in targets.scans:
                self._of_sensor.append(taken[scan.sensor])
                taken[scan.sensor] += 1

    def take(self, delivery: Delivery, answer: Estimate | None, seconds: float = math.nan, _: object = None) -> None:
        """Score the tracker's answer to a scan, with its mode probabilities, and keep the recorded estimates.

        Raises:
            Fault: the estimate cannot be scored, or the number of modes has changed.
        """
        self._has_answered = True
        self.scorer.take(delivery, answer, seconds)
        latest = answer or self.scorer.no_estimate
        recorded = self._recorded_members
        if delivery.number is not None and self._recorded is not None:
            white = whitened_innovation(latest, recorded)
            if white is not None:
                self._keep_nis(delivery.number, delivery.scan, white)
        if not delivery.last:
            return
        if latest.mode_probabilities is not None:
            self._take_modes(delivery.instant, latest.mode_probabilities)
        if self._recorded is not None:
            self._keep_recorded(delivery.instant, latest.mean[:, recorded], latest.covariance[:, :, recorded])

    def take_sequence(
        self, tracker: FilterTracker, state: TrackState, instants: Sequence[Sequence[Delivery]], first: int
    ) -> tuple[TrackState, int] | None:
        """Take the tracker through instants by one sequence of kernel calls, and score its estimates.

        Args:
            tracker: the tracker.
            state: state before the first instant.
            instants: scans that the tracker is given at each instant.
            first: index of the first instant.

        Returns:
            The state after the sequence and the number of its instants; None where steps have to be taken one by one.
        """
        from trackbench.runner.sequence_run import run_sequence

        scans = [[delivery.scan for delivery in group] for group in instants]
        taken = run_sequence(tracker, state, scans, self.scorer, first, self._recorded_run)
        if taken is None:
            return None
        sequence, recorded = taken
        numbers = [delivery.number for group in instants for delivery in group]
        for place, (step, number) in enumerate(zip(sequence.steps, numbers, strict=False)):
            instant, probability = first + step.instant, sequence.probability(place)
            if step.last and probability is not None:
                self._take_modes(instant, probability)
            if recorded is not None and step.last:
                self._keep_recorded(instant, *recorded.estimate(place))
            if recorded is not None and number is not None and step.reads:
                self._keep_nis(number, step.scan, recorded.whitened(place))
        return sequence.state(), sequence.steps[-1].instant + 1

    def close(self) -> list[Outcome]:
        """Return a list of one: the tracker's outcome (sums of scores, estimates kept) in its block.

        Raises:
            Fault: the tracker gave no estimate at all, and some were due.
            InputError: estimates of another program were made from other scans, or are of other objects.
        """
        if self._name in self._work.external_tracks:
            self._take_external()
        outcome = Outcome(self.scorer.close(), self._recorded, self._modes)
        if outcome.scores.due.sum() > 0 and not outcome.scores.given:
            raise Fault("it gave no estimate at all", len(self._target.time) - 1, None)
        return [outcome]

    def _take_external(self) -> None:
        rows = ExternalRows(self._work, self._piece, self._name, self._measurements)
        mean, covariance = external_estimates(rows, self._scene, len(self._piece.runs))
        groups = deliveries(self._measurements.scans, [], self._scene.each_measurement)
        for delivery in chain.from_iterable(groups):
            instant = delivery.instant
            estimate = Estimate(mean[:, instant].reshape(4, -1), covariance[:, :, instant].reshape(4, 4, -1))
            self.take(delivery, estimate)

    def failed(self, instant: int) -> None:
        """Tell the observer that the tracker failed and has no estimates from this instant on."""
        if self._observe is not None and self._recorded is not None:
            objects = self._recorded.mean.shape[-1]
            none = Gaussian(np.full((4, objects), np.nan), np.full((4, 4, objects), np.nan))
            self._observe(RecordedInstant(instant, {self._name: none}))

    def hint(self, fault: TrackFault) -> str:
        """Return the likely cause of a fault before the tracker's first answer; empty where no cause is likely."""
        return "" if self._has_answered or not fault.cause.startswith(OF_SHAPES) else NO_ANSWER_YET

    def place(self, member: int) -> tuple[str | None, int]:
        """Return name of the object and index of the run in the block, of the batch member with index ``member``."""
        object, run = divmod(member, len(self._piece.runs))
        return self._scene.truth.ids[object], run

    @property
    def _recorded_members(self) -> slice:
        return slice(self._recorded_run, None, len(self._piece.runs))

    def _take_modes(self, instant: int, probability: Array) -> None:
        self._modes = self._modes or ModeSums(len(probability), self._target, self._recorded_run)
        self._modes.take(instant, probability, self._target)

    def _keep_recorded(self, instant: int, mean: Array, covariance: Array) -> None:
        assert self._recorded is not None
        alive = self._target.alive[instant]
        recorded = Gaussian(np.where(alive, mean, np.nan), np.where(alive, covariance, np.nan))
        self._recorded.mean[:, instant], self._recorded.covariance[:, :, instant] = recorded
        if self._observe is not None:
            self._observe(RecordedInstant(instant, {self._name: recorded}))

    def _keep_nis(self, number: int, scan: Scan, white: Array) -> None:
        assert self._recorded is not None
        nis = np.where(scan.valid[self._recorded_members], np.einsum("i...,i...->...", white, white), np.nan)
        self._recorded.nis[scan.sensor][self._of_sensor[number]] = nis

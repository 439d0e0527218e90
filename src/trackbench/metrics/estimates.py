"""Sums of a tracker's errors and innovations, for all built-in metrics in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.breakdown import class_sums
from trackbench.metrics.consistency import BEYOND, beyond_points
from trackbench.metrics.innovations import Innovations
from trackbench.metrics.protocol import Chunk, Scope, SquaredErrors
from trackbench.metrics.sums import ERROR, ERROR_FIELDS, BlockScores, added, merge, stretch_numbers

if TYPE_CHECKING:
    from trackbench.metrics.score_sequence import ScoreSequence


class EstimateSums:
    """Accumulator of squared errors, NEES and NIS, whose sums all built-in metrics of estimates share."""

    name = "built-in"

    def init(self, scope: Scope) -> _BlockSums:
        return _BlockSums(scope)

    def update(self, sums: _BlockSums, chunk: Chunk) -> _BlockSums:
        sums.add(chunk)
        return sums

    def close(self, sums: _BlockSums) -> BlockScores:
        return sums.scores()

    def merge(self, blocks: Sequence[BlockScores]) -> BlockScores:
        return merge(blocks)


ESTIMATES = EstimateSums()


class _BlockSums:
    def __init__(self, scope: Scope) -> None:
        self._scope, self._target = scope, scope.labelled
        assert scope.classes is not None
        # In a single run, each stretch of time has its own classes.
        time = self._target.time
        instants, objects = self._target.alive.shape
        duration = float(time[-1] - time[0])
        stretch = stretch_numbers(instants, duration) if scope.single else np.zeros(instants, dtype=np.intp)
        self._stretch, self._stretches = stretch, int(stretch[-1]) + 1
        classes = scope.classes.astype(np.intp) * self._stretches + stretch[:, None, None]
        self._codes, place = np.unique(classes, return_inverse=True)
        self._class = place.reshape(scope.classes.shape)
        rows = len(ERROR_FIELDS)
        self._per_step = np.zeros((rows, instants))
        self._per_class = np.zeros((rows, len(self._codes), scope.runs))
        # Each estimate counts at the farthest point that its NEES is beyond.
        self._passed = np.zeros((len(BEYOND), len(self._codes), scope.runs))
        self._charged_per_step = np.zeros((rows, instants))
        self._charged_per_run = np.zeros((rows, scope.runs))
        self._diverged = np.zeros(scope.runs, dtype=bool)
        self._repaired = np.zeros(scope.runs)
        self._innovations = {
            name: Innovations(count, objects, scope.runs, scope.compute) for name, count in scope.measurements.items()
        }

    def add(self, chunk: Chunk) -> None:
        for sensor, innovations in chunk.innovations.items():
            for innovation in innovations:
                self._innovations[sensor].add(innovation.whitened, innovation.used, innovation.due)
        self._repaired += chunk.repaired
        instants, scored, values = chunk.instants, chunk.scored, chunk.values
        self._note_divergence(chunk.squares[0], scored & chunk.given)
        self._per_step[:, instants] = values.sum(axis=-1)
        self._add_by_class(values, self._class[instants])
        self._count_beyond(values[ERROR["nees"]], self._class[instants])
        if not chunk.given[scored].all():
            charged = np.where(chunk.given, 0.0, values)
            self._charged_per_step[:, instants] = charged.sum(axis=-1)
            self._charged_per_run += self._by_run(charged.sum(axis=1))

    @property
    def classes(self) -> tuple[Indices, int]:
        """Class number of each object, ``(instants, objects, runs or 1)``, and number of classes."""
        return self._class, len(self._codes)

    def add_sequence(self, scores: ScoreSequence, squares: SquaredErrors, repaired: Array) -> None:
        """Add the sums over instants that compiled kernels have scored.

        Args:
            scores: sums over these instants.
            squares: squared errors at these instants.
            repaired: ``(runs,)`` number of repaired covariances.
        """
        fields = len(ERROR_FIELDS)
        self._per_step[:, scores.instants] = scores.per_step
        self._per_class += scores.by_class[:fields]
        # Counts beyond one point and not beyond the next.
        self._passed -= np.diff(scores.by_class[fields:], axis=0, append=0.0)
        self._repaired += repaired
        self._note_divergence(squares.squares[0], squares.scored & squares.given)

    def innovations(self, sensor: str) -> Innovations:
        return self._innovations[sensor]

    def _note_divergence(self, square: Array, counts: Mask) -> None:
        far = (square > self._target.divergence**2) & counts
        if far.any():
            self._diverged |= self._by_run(np.asarray(far.any(axis=0))) > 0

    def scores(self) -> BlockScores:
        errors, beyond = self._per_class, np.cumsum(self._passed[::-1], axis=0)[::-1]
        codes, stretch = divmod(self._codes, self._stretches)
        per_run = per_part = errors.sum(axis=1)
        charged, single = self._charged_per_run, self._scope.single
        if single:
            part = stretch[:, None] == np.arange(self._stretches)
            errors, beyond = errors * part, beyond * part
            per_part, charged = (added(sums, self._stretch) for sums in (self._per_step, self._charged_per_step))
        return BlockScores(
            per_step=self._per_step,
            per_run=per_run,
            per_part=per_part,
            charged=charged,
            due=self._by_run(self._target.each(self._target.due).sum(axis=0)),
            diverged=self._diverged.astype(float),
            repaired=self._repaired,
            nis={name: item.scores(self._stretches * single) for name, item in self._innovations.items()},
            classes=[(self._scope.runs, class_sums(codes, errors, beyond))],
            stretches=[self._stretches] if single else None,
        )

    def _by_run(self, batch: Array) -> Array:
        return np.asarray(batch.reshape(*batch.shape[:-1], -1, self._scope.runs).sum(axis=-2))

    def _add_by_class(self, values: Array, classes: Indices) -> None:
        runs, per_class = self._scope.runs, self._per_class
        if classes.shape[-1] == 1:
            of_row, rows = classes.reshape(-1), values.reshape(len(values), -1, runs)
            present = np.flatnonzero(np.bincount(of_row))
            if len(of_row) > 2 * len(present):
                rows = np.stack([rows[:, of_row == place].sum(axis=1) for place in present], axis=1)
                of_row = present
            # An index of several classes would copy.
            for number, place in enumerate(of_row):
                per_class[:, place] += rows[:, number]
            return
        places = (classes * runs + np.arange(runs)).reshape(-1)
        for total, value in zip(per_class, values, strict=True):
            total += np.bincount(places, value.reshape(-1), total.size).reshape(total.shape)

    def _count_beyond(self, nees: Array, classes: Indices) -> None:
        """Count each NEES ``(instants, batch)``, by class and run, at the farthest chi-square point that it exceeds."""
        points, runs = beyond_points(4), self._scope.runs
        cells = np.flatnonzero(nees > points[0])
        place = classes.reshape(-1)[cells // runs if classes.shape[-1] == 1 else cells]
        farthest = np.searchsorted(points, nees.reshape(-1)[cells]) - 1
        # A flat index is ten times as fast.
        np.add.at(self._passed.reshape(-1), (farthest * len(self._codes) + place) * runs + cells % runs, 1.0)

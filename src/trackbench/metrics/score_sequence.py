"""Sequences of kernel calls that score estimates and innovations, and sum the scores."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.engine.sequences import ArrayPlace, CallSequence, place, total_of_vectors
from trackbench.engine.vector_code import WIDTH
from trackbench.metrics.consistency import BEYOND
from trackbench.metrics.errors import SCORES
from trackbench.metrics.innovations import INNOVATION_SUMS
from trackbench.metrics.protocol import Target
from trackbench.metrics.sums import ERROR_FIELDS, NIS_FIELDS


class ScoreSequence:
    """Sums of the scores of estimates at successive instants, made by a sequence of kernel calls.

    Args:
        target: ground truth that the estimates are compared with.
        classes: ``(instants, objects)`` number of the class of each object.
        count: number of classes.
        instants: slice of the instants.
    """

    def __init__(self, target: Target, classes: Indices, count: int, instants: slice) -> None:
        self._target, self.instants = target, instants
        steps, objects, runs = instants.stop - instants.start, *target.due.shape[1:]
        self._shape = steps, objects, runs
        self._classes = classes[instants]
        self._per_step = np.zeros((len(ERROR_FIELDS), steps, WIDTH))
        self.by_class = np.zeros((len(ERROR_FIELDS) + len(BEYOND), count, runs))
        """Sums of squared errors, NEES and the other rows of ``ERROR_FIELDS`` by class of condition and run, then the
        number of NEES beyond each point of chi-square."""
        self._squares = np.empty((2, *self._shape))
        self._definite, self._bounded = np.empty((2, *self._shape), dtype=bool)

    def add(self, sequence: CallSequence, at: Indices, mean: ArrayPlace, covariance: ArrayPlace) -> bool:
        """Add calls that score estimates, at the positions ``at`` of the sequence; return False if no kernel exists."""
        instants, runs = np.arange(self.instants.start, self.instants.stop), self._shape[2]
        row_numbers, by_class = np.arange(len(instants)), self.by_class
        inputs = {
            "mean": mean,
            "covariance": covariance,
            "truth": place(self._target.state, 1, instants),
            "reference": place(self._target.reference, 1, instants),
            "due": self.due(row_numbers),
        }
        outputs = {
            "per_step": place(self._per_step[..., None], 1, row_numbers)._replace(group=0),
            "by_class": ArrayPlace(by_class.ctypes.data + self._classes.T * (8 * runs), by_class.strides[0] // 8),
            "squares": place(self._squares, 1, row_numbers),
            "definite": place(self._definite, 0, row_numbers),
            "bounded": place(self._bounded, 0, row_numbers),
        }
        return sequence.compute(SCORES, at, inputs, outputs)

    def due(self, instants: Indices) -> ArrayPlace:
        """Return the addresses of the masks of due estimates at some instants, counted from the sequence's first."""
        return place(self._target.due, 0, self.instants.start + instants)

    @property
    def sound(self) -> bool:
        """Whether all estimates could be scored: finite, with positive definite covariances."""
        return bool(self._definite.all() and self._bounded.all())

    @property
    def per_step(self) -> Array:
        """``(15, instants)`` sums over objects and runs of errors, NEES and the other rows of ``ERROR_FIELDS``."""
        return total_of_vectors(self._per_step)

    @property
    def squares(self) -> Array:
        """``(2, instants, batch)`` squared errors of position and velocity where an estimate is due; else 0."""
        return self._squares.reshape(2, self._shape[0], -1)


class InnovationSequence:
    """Sums over the innovations of a sensor at successive measurements, made by kernel calls.

    Args:
        white: ``(m, batch)`` whitened innovations of the last measurement before the sequence.
        used: ``(batch,)`` mask of the innovations that are scored.
        shape: numbers of objects and of runs.
        count: number of measurements.
    """

    def __init__(self, white: Array, used: Mask, shape: tuple[int, int], count: int) -> None:
        # The components of a measurement are contiguous in memory.
        self._white = np.empty((3, len(white), *shape)).swapaxes(0, 1)
        self._used = np.empty((3, *shape), dtype=bool)
        self._white[:, 0], self._used[0] = white.reshape(-1, *shape), used.reshape(shape)
        # Slot 0 has the last measurement before the sequence; slots 1 and 2 take turns.
        self._slots = 1 + np.arange(count) % 2
        self._per_step, self.per_run = np.zeros((len(NIS_FIELDS), count, WIDTH)), np.zeros((len(NIS_FIELDS), shape[1]))
        self.white = place(self._white, 1, self._slots)
        """Addresses to which the caller writes the whitened innovations of each measurement."""

    def add(self, sequence: CallSequence, at: Indices, valid: ArrayPlace, due: ArrayPlace) -> bool:
        """Add calls that sum innovations, at the positions ``at`` of the sequence; return False if no kernel exists."""
        number, before = np.arange(len(at)), np.concatenate([[0], self._slots[:-1]])
        inputs = {"white": self.white, "valid": valid, "due": due}
        inputs |= {"white_before": place(self._white, 1, before), "used_before": place(self._used, 0, before)}
        outputs = {
            "per_step": place(self._per_step[..., None], 1, number)._replace(group=0),
            "per_run": place(self.per_run[:, None, None], 1, 0 * number),
            "used": place(self._used, 0, self._slots),
        }
        return sequence.compute(INNOVATION_SUMS, at, inputs, outputs)

    @property
    def per_step(self) -> Array:
        """``(7, count)`` sums at each measurement: rows ``NIS_FIELDS``, such as number of innovations and NIS."""
        return total_of_vectors(self._per_step)

    @property
    def latest(self) -> tuple[Array, Mask]:
        """Whitened innovations ``(m, batch)`` of the last measurement, and the mask ``(batch,)`` of scored ones."""
        return self._white[:, self._slots[-1]].reshape(len(self._white), -1), self._used[self._slots[-1]].reshape(-1)

"""Scores of estimates and innovations that a sequence of calls of kernels makes, summed by the same sequence."""

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
    """Scores at successive instants.

    Args:
        target: what the estimates are held against.
        classes: ``(instants, objects)`` number of the class of each object.
        count: how many classes there are.
        here: which instants.
    """

    def __init__(self, target: Target, classes: Indices, count: int, here: slice) -> None:
        self._target, self.here = target, here
        instants, objects, runs = here.stop - here.start, *target.due.shape[1:]
        self._shape = instants, objects, runs
        self._classes = classes[here]
        self._per_step = np.zeros((len(ERROR_FIELDS), instants, WIDTH))
        self.by_class = np.zeros((len(ERROR_FIELDS) + len(BEYOND), count, runs))
        """Sums of the classes in each run: rows as ``ERROR_FIELDS``, and how many NEES are beyond each point."""
        self._squares = np.empty((2, *self._shape))
        self._definite, self._bounded = np.empty((2, *self._shape), dtype=bool)

    def add(self, sequence: CallSequence, at: Indices, mean: ArrayPlace, covariance: ArrayPlace) -> bool:
        """Add the calls ``(instants,)`` that score estimates to a sequence; whether there is a kernel for them."""
        instants, runs = np.arange(self.here.start, self.here.stop), self._shape[2]
        own, rows = np.arange(len(instants)), self.by_class
        inputs = {
            "mean": mean,
            "covariance": covariance,
            "truth": place(self._target.state, 1, instants),
            "reference": place(self._target.reference, 1, instants),
            "due": self.due(own),
        }
        outputs = {
            "per_step": place(self._per_step[..., None], 1, own)._replace(group=0),
            "by_class": ArrayPlace(rows.ctypes.data + self._classes.T * (8 * runs), rows.strides[0] // 8),
            "squares": place(self._squares, 1, own),
            "definite": place(self._definite, 0, own),
            "bounded": place(self._bounded, 0, own),
        }
        return sequence.compute(SCORES, at, inputs, outputs)

    def due(self, instants: Indices) -> ArrayPlace:
        """Return where it lies whether estimates are due at instants, numbered from the first of these."""
        return place(self._target.due, 0, self.here.start + instants)

    @property
    def sound(self) -> bool:
        """Whether all estimates could be scored."""
        return bool(self._definite.all() and self._bounded.all())

    @property
    def per_step(self) -> Array:
        """``(15, instants)`` sums, rows ``ERROR_FIELDS``."""
        return total_of_vectors(self._per_step)

    @property
    def squares(self) -> Array:
        """``(2, instants, batch)`` squared errors of position and velocity where an estimate is due; else 0."""
        return self._squares.reshape(2, self._shape[0], -1)


class InnovationSequence:
    """Sums over the innovations of a sensor at successive measurements.

    Args:
        white: ``(m, batch)`` whitened innovations of the measurement before them.
        used: ``(batch,)`` which of those count.
        shape: numbers of objects and of runs.
        count: how many measurements there are.
    """

    def __init__(self, white: Array, used: Mask, shape: tuple[int, int], count: int) -> None:
        # All components of a measurement lie one behind the other.
        self._white = np.empty((3, len(white), *shape)).swapaxes(0, 1)
        self._used = np.empty((3, *shape), dtype=bool)
        self._white[:, 0], self._used[0] = white.reshape(-1, *shape), used.reshape(shape)
        # Two slots in turn, behind that of the measurement before.
        self._own = 1 + np.arange(count) % 2
        self._per_step, self.per_run = np.zeros((len(NIS_FIELDS), count, WIDTH)), np.zeros((len(NIS_FIELDS), shape[1]))
        self.white = place(self._white, 1, self._own)
        """Where the whitened innovations of each measurement are to be put."""

    def add(self, sequence: CallSequence, at: Indices, valid: ArrayPlace, due: ArrayPlace) -> bool:
        """Add the calls ``(count,)`` that sum innovations to a sequence; whether there is a kernel for them."""
        number, before = np.arange(len(at)), np.concatenate([[0], self._own[:-1]])
        inputs = {"white": self.white, "valid": valid, "due": due}
        inputs |= {"white_before": place(self._white, 1, before), "used_before": place(self._used, 0, before)}
        outputs = {
            "per_step": place(self._per_step[..., None], 1, number)._replace(group=0),
            "per_run": place(self.per_run[:, None, None], 1, 0 * number),
            "used": place(self._used, 0, self._own),
        }
        return sequence.compute(INNOVATION_SUMS, at, inputs, outputs)

    @property
    def per_step(self) -> Array:
        """``(7, count)`` sums, rows ``NIS_FIELDS``."""
        return total_of_vectors(self._per_step)

    @property
    def latest(self) -> tuple[Array, Mask]:
        """Whitened innovations ``(m, batch)`` of the last measurement, and which of them count."""
        return self._white[:, self._own[-1]].reshape(len(self._white), -1), self._used[self._own[-1]].reshape(-1)

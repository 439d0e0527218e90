"""Sums over the innovations of one sensor, several measurements at a time so that NumPy's calls are few."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.metrics.consistency import point95
from trackbench.metrics.sums import NIS, NIS_FIELDS, OVERFLOW, NisScores, added

#: How many measurements are summed at a time.
CHUNK = 32


def _innovation(values: Values) -> Values:
    white, used, nis = _counted(values["white"], values["used"])
    white_before, used_before, _ = _counted(values["white_before"], values["used_before"])
    pair, inside, missing = used & used_before, used & (nis < values["point95"]), values["due"] & ~used
    product = np.where(pair, np.einsum("m...,m...->...", white, white_before), 0.0)
    return {"rows": linalg.vector([used, nis, inside, pair, product, np.where(pair, nis, 0.0), missing])}


def _counted(white: Array, used: Any) -> tuple[Array, Any, Array]:
    """Innovations that count, zero elsewhere, which of them do, and their NIS: those that are used and can be summed.

    A sequence of calls leaves what is not used as it is, so that it may be anything.
    """
    white = np.where(used, white, 0.0)
    nis = np.einsum("m...,m...->...", white, white)
    counted = used & (nis < OVERFLOW)
    return white, counted, np.where(counted, nis, 0.0)


#: Of a whitened innovation ``white`` and the one before it, which are anything unless they are ``used``: ``rows`` as
#: NIS_FIELDS. ``due``: whether there should be one.
INNOVATION = Equations(
    "whitened innovation",
    _innovation,
    {"white": 1, "used": 0, "white_before": 1, "used_before": 0, "due": 0, "point95": 0},
)


class Innovations:
    """Collects whitened innovations; ``scores`` gives the sums at the end.

    They lie in rows, one for each measurement. Before the rows that are not summed yet is that of the measurement
    before them. A row that was not written yet is not used.
    """

    def __init__(self, measurements: int, objects: int, runs: int, compute: Compute = by_numpy) -> None:
        """``measurements``: how many the sensor takes."""
        self._shape = objects, runs
        self._compute = compute
        self._per_step = np.zeros((len(NIS_FIELDS), measurements))
        self._per_run = np.zeros((len(NIS_FIELDS), runs))
        self._white = np.empty((0, 0, objects * runs))
        self._used = np.zeros((1 + CHUNK, objects * runs), dtype=bool)
        self._due = self._used.copy()
        self._measurement = self._dof = 0
        self._first = self._next = 1

    def add(self, white: Array | None, used: Mask, due: Mask) -> None:
        """Take in the whitened innovations ``(m, batch)`` of the next measurement, None where the tracker gives none.

        ``used`` ``(batch,)``: which of them count. ``due`` ``(batch,)``: which of them there should be.
        """
        if white is None and not self._dof:
            self._per_step[NIS["missing"], self._measurement] = due.sum()
            self._per_run[NIS["missing"]] += due.reshape(self._shape).sum(axis=0)
            self._measurement += 1
            return
        if not self._dof and white is not None:
            self._dof = len(white)
            self._white = np.zeros((len(self._used), self._dof, self._used.shape[1]))
        rows, its_used, its_due = self.rows(1)
        rows[0] = 0.0 if white is None else white
        its_used[0] = False if white is None else used
        its_due[0] = due
        if self._next - self._first >= CHUNK:
            self.flush()

    @property
    def known(self) -> bool:
        """Whether an innovation was taken in, so that their size is known."""
        return self._dof > 0

    def rows(self, count: int) -> tuple[Array, Mask, Mask]:
        """Rows for the next measurements: of whitened innovations ``(count, dof, batch)``, which are used, and due."""
        if self._next + count > len(self._white):
            self.flush()
            arrays = self._white, self._used, self._due
            if 1 + count > len(self._white):
                self._white, self._used, self._due = (
                    np.zeros((1 + count, *each.shape[1:]), each.dtype) for each in arrays
                )
            for before, after in zip(arrays, (self._white, self._used, self._due), strict=True):
                after[0] = before[self._next - 1]
            self._first = self._next = 1
        here = slice(self._next, self._next + count)
        self._next += count
        return self._white[here], self._used[here], self._due[here]

    def drop(self, count: int) -> None:
        """Take back the latest rows, which were not filled."""
        self._next -= count

    def flush(self) -> None:
        """Sum what waits."""
        here, before = slice(self._first, self._next), slice(self._first - 1, self._next - 1)
        if self._next == self._first:
            return
        white, used = self._white[here], self._used[here]
        inputs = {
            "white": white.swapaxes(0, 1),
            "used": used,
            "white_before": self._white[before].swapaxes(0, 1),
            "used_before": self._used[before],
            "due": self._due[here],
            "point95": point95(self._dof),
        }
        values = self._compute(INNOVATION, inputs)["rows"]
        self._per_step[:, self._measurement : self._measurement + len(white)] = values.sum(axis=-1)
        self._per_run += values.sum(axis=1).reshape(len(values), *self._shape).sum(axis=1)
        self._measurement += len(white)
        self._first = self._next

    def scores(self, stretches: int = 0) -> NisScores:
        """Return the sums of everything taken in; ``stretches``: the number of parts of a single run, else 0."""
        self.flush()
        per_part = self._per_run
        if stretches:
            count = self._per_step.shape[1]
            per_part = added(self._per_step, np.arange(count) * stretches // max(count, 1))
        return NisScores(self._dof, self._per_step, self._per_run, per_part)

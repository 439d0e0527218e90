"""Sums over the innovations of one sensor, several measurements at a time so that NumPy's calls are few."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.engine.choice import kernels_of
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.engine.layout import ADDED, SUMMED, Input
from trackbench.metrics.consistency import point95
from trackbench.metrics.sums import NIS, NIS_FIELDS, OVERFLOW, NisScores

#: How many measurements are summed at a time by NumPy.
CHUNK = 10
#: Measurements that fill the rows before the latest is moved to the front.
ROWS = 4 * CHUNK


def _innovation(values: Values) -> Values:
    white, used, pair = values["white"], values["used"], values["used"] & values["used_before"]
    nis = np.einsum("m...,m...->...", white, white)
    inside, missing = used & (nis < values["point95"]), values["due"] & ~used
    product = np.einsum("m...,m...->...", white, values["white_before"])
    return {"rows": linalg.vector([used, nis, inside, pair, product, np.where(pair, nis, 0.0), missing])}


#: Of a whitened innovation ``white`` and the one before it, which are zero unless they are ``used``: ``rows`` as
#: NIS_FIELDS. ``due``: whether there should be one.
INNOVATION = Equations(
    "whitened innovation",
    _innovation,
    {"white": 1, "used": 0, "white_before": 1, "used_before": 0, "due": 0, "point95": 0},
)


def _sums(values: Values) -> Values:
    used = values["used"]
    white = np.where(used[:, None], values["white"], 0.0)
    latest = {"white": white[1], "used": used[1], "white_before": white[0], "used_before": used[0]}
    rows = _innovation({**values, **latest})["rows"]
    return {"per_step": rows, "per_run": rows, "bounded": rows[NIS["nis"]] < OVERFLOW}


#: Of the whitened innovations of the measurement before and of a measurement, and where they are ``used``: what is
#: added to the sums; ``bounded``: whether it can be.
SUMS = Equations(
    "sums of whitened innovations",
    _sums,
    {"white": 2, "used": 1, "due": 0, "point95": 0},
    modes={"per_step": SUMMED, "per_run": ADDED},
)


class Innovations:
    """Collects whitened innovations; ``scores`` gives the sums at the end.

    They lie in rows, one for each measurement. Before the rows that are not summed yet is that of the measurement
    before them. A row that was not written yet is not used.
    """

    def __init__(self, measurements: int, objects: int, runs: int, compute: Compute = by_numpy) -> None:
        """``measurements``: how many the sensor takes."""
        self._shape = objects, runs
        self._compute, self._kernels = compute, kernels_of(compute, runs)
        self._per_step = np.zeros((len(NIS_FIELDS), measurements))
        self._per_run = np.zeros((len(NIS_FIELDS), runs))
        self._white = np.empty((0, 0, objects * runs))
        self._used = np.zeros((1 + ROWS, objects * runs), dtype=bool)
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
        if self._next - self._first >= (ROWS if self._kernels else CHUNK):
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
        if self._next > self._first and not self._summed_by_kernels():
            if self._kernels is not None:
                # Kernels leave what is not used as it is.
                before = slice(self._first - 1, self._first)
                _clear(self._white[before], self._used[before])
            for first in range(self._first, self._next, CHUNK):
                self._sum(slice(first, min(first + CHUNK, self._next)))
        self._measurement += self._next - self._first
        self._first = self._next

    def _summed_by_kernels(self) -> bool:
        """Sum what waits by one sequence of calls; whether it could be done."""
        if self._kernels is None:
            return False
        from trackbench.engine.sequences import ArrayPlace, CallSequence, place, total_of_vectors
        from trackbench.engine.vector_code import WIDTH

        inputs = (
            Input("white", (2, self._dof), 1, "d"),
            Input("used", (2,), 1, "?"),
            Input("due", (), 1, "?"),
            Input("point95", (), 0, "d"),
        )
        kernel = self._kernels.kernel(SUMS, inputs)
        if kernel is None:
            return False
        (objects, runs), count, fields = self._shape, self._next - self._first, len(NIS_FIELDS)
        per_step, per_run = np.zeros((fields, count, WIDTH)), np.zeros((fields, runs))
        bounded = np.empty((count, objects, runs), dtype=bool)
        at, nothing, limit = np.arange(count), np.zeros(count, dtype=np.intp), np.array([point95(self._dof)])
        before, batch = self._first - 1 + at, objects * runs
        sequence = CallSequence(self._kernels, objects, runs, count)
        inputs_at = {
            "white": ArrayPlace(self._white.ctypes.data + before * self._white.strides[0], batch, runs * 8),
            "used": ArrayPlace(self._used.ctypes.data + before * batch, batch, runs),
            "due": ArrayPlace(self._due.ctypes.data + (self._first + at) * batch, 0, runs),
            "point95": place(limit, 0, nothing),
        }
        outputs_at = {
            "per_step": place(per_step[..., None], 1, at)._replace(group=0),
            "per_run": place(per_run[:, None, None], 1, nothing),
            "bounded": place(bounded, 0, at),
        }
        sequence.call(kernel, at, inputs_at, outputs_at)
        if not sequence.run() or not bounded.all():
            return False
        self._per_step[:, self._measurement : self._measurement + count] = total_of_vectors(per_step)
        self._per_run += per_run
        return True

    def _sum(self, here: slice) -> None:
        """Sum some rows by NumPy."""
        white, used = self._white[here], self._used[here]
        _clear(white, used)
        before = slice(here.start - 1, here.stop - 1)
        inputs = {
            "white": white.swapaxes(0, 1),
            "used": used,
            "white_before": self._white[before].swapaxes(0, 1),
            "used_before": self._used[before],
            "due": self._due[here],
            "point95": point95(self._dof),
        }
        values = self._compute(INNOVATION, inputs)["rows"]
        measurement = self._measurement + here.start - self._first
        self._per_step[:, measurement : measurement + len(white)] = values.sum(axis=-1)
        self._per_run += values.sum(axis=1).reshape(len(values), *self._shape).sum(axis=1)

    def scores(self) -> NisScores:
        """The sums of everything taken in."""
        self.flush()
        return NisScores(self._dof, self._per_step, self._per_run)


def _clear(white: Array, used: Mask) -> None:
    """Set innovations ``(count, m, batch)`` to zero that are not used ``(count, batch)``, or cannot be summed."""
    if not used.all():
        np.copyto(white, 0.0, where=~used[:, None])
    if not np.vdot(white, white) < OVERFLOW:
        used &= np.einsum("tml,tml->tl", white, white) < OVERFLOW
        np.copyto(white, 0.0, where=~used[:, None])

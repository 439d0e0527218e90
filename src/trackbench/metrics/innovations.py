"""Sums over the innovations of one sensor, several measurements at a time so that NumPy's calls are few."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.metrics.consistency import point95
from trackbench.metrics.sums import LAG_FIELDS, LAGS, NIS, NIS_FIELDS, OVERFLOW, NisScores

#: How many measurements are summed at a time: their products with those before grow with its square.
CHUNK = 10


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


class Innovations:
    """Collects whitened innovations; ``scores`` gives the sums at the end.

    The latest measurements are kept in a ring of as many rows as the longest lag needs, in which a chunk of them is
    never broken. A row that was not written yet holds zeros, which add nothing to any sum.
    """

    def __init__(self, measurements: int, objects: int, runs: int, compute: Compute = by_numpy) -> None:
        """``measurements``: how many the sensor takes."""
        self._shape = objects, runs
        self._compute = compute
        self._rows = CHUNK * (1 + -(-LAGS // CHUNK))
        self._per_step = np.zeros((len(NIS_FIELDS), measurements))
        self._per_run = np.zeros((len(NIS_FIELDS), runs))
        self._pairs = np.zeros((len(LAG_FIELDS), self._rows, self._rows))
        # The last row of the ring comes first once more, so that each row has the one before it.
        self._white: Array | None = None
        self._used = np.zeros((self._rows + 1, objects * runs), dtype=bool)
        self._due = np.zeros((CHUNK, objects * runs), dtype=bool)
        self._measurement = self._row = self._filled = self._dof = 0

    def add(self, white: Array | None, used: Mask, due: Mask) -> None:
        """Take in the whitened innovations ``(m, batch)`` of the next measurement, None where the tracker gives none.

        ``used`` ``(batch,)``: which of them count. ``due`` ``(batch,)``: which of them there should be.
        """
        if self._white is None:
            if white is None:
                self._per_step[NIS["missing"], self._measurement] = due.sum()
                self._per_run[NIS["missing"]] += due.reshape(self._shape).sum(axis=0)
                self._measurement += 1
                return
            self._white = np.zeros((self._rows + 1, *white.shape))
            self._dof = len(white)
        row = 1 + self._row + self._filled
        self._white[row] = 0.0 if white is None else white
        self._used[row] = False if white is None else used
        self._due[self._filled] = due
        self._filled += 1
        if self._filled == CHUNK:
            self.flush()

    def flush(self) -> None:
        """Sum what waits."""
        if self._white is None or self._filled == 0:
            return
        count, row = self._filled, self._row
        here = slice(1 + row, 1 + row + count)
        _clear(self._white[here], self._used[here])
        values = self._values(self._white, here)
        measurements = slice(self._measurement, self._measurement + count)
        self._per_step[:, measurements] = values @ np.ones(values.shape[-1])
        self._per_run += (np.ones(count) @ values).reshape(len(values), *self._shape).sum(axis=1)
        self._add_pairs(slice(row, row + count), self._white[here], values[NIS["nis"]])
        self._measurement, self._row, self._filled = measurements.stop, (row + count) % self._rows, 0
        if self._row == 0:
            self._white[0], self._used[0] = self._white[-1], self._used[-1]

    def _values(self, ring: Array, here: slice) -> Array:
        """``(7, count, batch)`` rows ``NIS_FIELDS`` of rows of the ring."""
        before = slice(here.start - 1, here.stop - 1)
        inputs = {
            "white": ring[here].swapaxes(0, 1),
            "used": self._used[here],
            "white_before": ring[before].swapaxes(0, 1),
            "used_before": self._used[before],
            "due": self._due[: self._filled],
            "point95": point95(self._dof),
        }
        return self._compute(INNOVATION, inputs)["rows"]

    def _add_pairs(self, here: slice, white: Array, nis: Array) -> None:
        """Add the products of the measurements ``here`` with every one in the ring: one product of matrices."""
        assert self._white is not None
        ring, all_used = self._white[1:], self._used[1:]
        count, pairs = len(white), self._pairs[:, here]
        pairs[1] += white.reshape(count, -1) @ ring.reshape(self._rows, -1).T
        if all_used.all():
            pairs[0] += nis.shape[1]
            pairs[2] += nis.sum(axis=1)[:, None]
        else:
            used = all_used.astype(float)
            pairs[0] += used[here] @ used.T
            pairs[2] += nis @ used.T

    def scores(self) -> NisScores:
        """The sums of everything taken in."""
        self.flush()
        # Two measurements are as far apart as their rows, modulo the number of rows.
        rows = np.arange(self._rows)
        lag = (rows[:, None] - rows) % self._rows
        lags = [np.bincount(lag.ravel(), pairs.ravel())[: LAGS + 1] for pairs in self._pairs]
        return NisScores(self._dof, self._per_step, self._per_run, np.stack(lags))


def _clear(white: Array, used: Mask) -> None:
    """Set innovations ``(count, m, batch)`` to zero that are not used ``(count, batch)``, or cannot be summed."""
    if not used.all():
        np.copyto(white, 0.0, where=~used[:, None])
    if not np.vdot(white, white) < OVERFLOW:
        used &= np.einsum("tml,tml->tl", white, white) < OVERFLOW
        np.copyto(white, 0.0, where=~used[:, None])

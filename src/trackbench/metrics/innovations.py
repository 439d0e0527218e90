"""Sums over the innovations of one sensor, several measurements at a time so that NumPy's calls are few."""

from __future__ import annotations

import numpy as np

from trackbench.metrics.consistency import point95
from trackbench.metrics.sums import LAG_FIELDS, LAGS, NIS, NIS_FIELDS, OVERFLOW, NisScores
from trackbench.types import Array, Mask


class Innovations:
    """Collects whitened innovations; ``scores`` gives the sums at the end.

    The latest measurements are kept in a ring of as many rows as the longest lag needs, in which a chunk is never
    broken. A row that was not written yet holds zeros, which add nothing to any sum.
    """

    def __init__(self, measurements: int, objects: int, runs: int, chunk: int) -> None:
        """``measurements``: how many the sensor takes. ``chunk``: how many of them are summed at a time."""
        self._shape = objects, runs
        # The products of a chunk with the ring grow with its square.
        self._chunk = min(chunk, LAGS)
        self._rows = self._chunk * (1 + -(-LAGS // self._chunk))
        self._per_step = np.zeros((len(NIS_FIELDS), measurements))
        self._per_run = np.zeros((len(NIS_FIELDS), runs))
        self._pairs = np.zeros((len(LAG_FIELDS), self._rows, self._rows))
        self._white: Array | None = None
        self._used = np.zeros((self._rows, objects * runs), dtype=bool)
        self._due = np.zeros((self._chunk, objects * runs), dtype=bool)
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
            self._white = np.zeros((self._rows, *white.shape))
        self._white[self._row + self._filled] = 0.0 if white is None else white
        self._used[self._row + self._filled] = used & (white is not None)
        self._due[self._filled] = due
        self._filled += 1
        if self._filled == self._chunk:
            self.flush()

    def flush(self) -> None:
        """Sum what waits."""
        if self._white is None or self._filled == 0:
            return
        count, row = self._filled, self._row
        here = slice(row, row + count)
        white, used = self._white[here], self._used[here]
        nis = np.einsum("tml,tml->tl", white, white)
        used &= nis < OVERFLOW
        if not used.all():
            np.copyto(nis, 0.0, where=~used)
            np.copyto(white, 0.0, where=~used[:, None])
        self._dof = white.shape[1]
        # Row 0 follows the last row of the ring.
        before = np.concatenate([self._used[row - 1][None], used[:-1]])
        values = np.empty((len(NIS_FIELDS), *nis.shape))
        values[0] = used
        values[1] = nis
        values[2] = used & (nis < point95(self._dof))
        values[3] = used & before
        values[4, 0] = np.einsum("ml,ml->l", white[0], self._white[row - 1])
        np.einsum("tml,tml->tl", white[1:], white[:-1], out=values[4, 1:])
        np.multiply(nis, values[3], out=values[5])
        values[6] = self._due[:count] & ~used
        measurements = slice(self._measurement, self._measurement + count)
        self._per_step[:, measurements] = values @ np.ones(nis.shape[1])
        self._per_run += (np.ones(count) @ values).reshape(len(values), *self._shape).sum(axis=1)
        self._add_pairs(here, white, nis)
        self._measurement, self._row, self._filled = measurements.stop, (row + count) % self._rows, 0

    def _add_pairs(self, here: slice, white: Array, nis: Array) -> None:
        """Add the products of the measurements ``here`` with every one in the ring: one product of matrices."""
        assert self._white is not None
        count, pairs = len(white), self._pairs[:, here]
        pairs[1] += white.reshape(count, -1) @ self._white.reshape(self._rows, -1).T
        if self._used.all():
            pairs[0] += nis.shape[1]
            pairs[2] += nis.sum(axis=1)[:, None]
        else:
            used = self._used.astype(float)
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

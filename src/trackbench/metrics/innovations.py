"""Sums over the innovations of one sensor, computed for several measurements at a time to save NumPy calls."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.engine.layout import ADDED, SUMMED
from trackbench.metrics.consistency import point95
from trackbench.metrics.sums import NIS, NIS_FIELDS, OVERFLOW, NisScores, added

#: Number of measurements that are summed at a time.
CHUNK = 32


def _innovation(values: Values) -> Values:
    white, used, nis = _counted(values["white"], values["used"])
    white_before, used_before, _ = _counted(values["white_before"], values["used_before"])
    pair, inside = used & used_before, used & (nis < point95(len(white)))
    product = np.where(pair, np.einsum("m...,m...->...", white, white_before), 0.0)
    missing = values["due"] & ~used
    return {"rows": linalg.vector([used, nis, inside, pair, product, np.where(pair, nis, 0.0), missing])}


def _innovation_sums(values: Values) -> Values:
    used = values["valid"] & values["due"]
    rows = _innovation({**values, "used": used, "due": used})["rows"]
    return {"per_step": rows, "per_run": rows, "used": used}


def _counted(white: Array, used: Any) -> tuple[Array, Any, Array]:
    """Return the innovations with zeros where they are not scored, the mask of scored ones, and their NIS.

    An innovation is scored if it is used and its NIS can be summed. A sequence of kernel calls leaves arbitrary values
    in unused innovations.
    """
    white = np.where(used, white, 0.0)
    nis = np.einsum("m...,m...->...", white, white)
    counted = used & (nis < OVERFLOW)
    return white, counted, np.where(counted, nis, 0.0)


#: ``rows``, as NIS_FIELDS, of a whitened innovation ``white`` and of the previous one; both may be anything unless
#: ``used``. ``due``: whether the tracker should give an innovation.
INNOVATION = Equations(
    "whitened innovation",
    _innovation,
    {"white": 1, "used": 0, "white_before": 1, "used_before": 0, "due": 0},
)
#: Terms that a whitened innovation in a sequence of calls adds to the sums. It is used where the measurement is
#: ``valid`` and the estimate is ``due``; the tracker has an estimate before each measurement.
INNOVATION_SUMS = Equations(
    "sums of whitened innovations",
    _innovation_sums,
    {"white": 1, "valid": 0, "white_before": 1, "used_before": 0, "due": 0},
    modes={"per_step": SUMMED, "per_run": ADDED},
)


class Innovations:
    """Running sums over the whitened innovations of one sensor; ``scores`` returns the sums at the end.

    New measurements wait in rows; row 0 holds the latest measurement that is summed.
    """

    def __init__(self, measurements: int, objects: int, runs: int, compute: Compute = by_numpy) -> None:
        """Start with sums of zero, for a sensor that takes this number of ``measurements`` in a run."""
        self._shape = objects, runs
        self._compute = compute
        self._per_step = np.zeros((len(NIS_FIELDS), measurements))
        self._per_run = np.zeros((len(NIS_FIELDS), runs))
        self._white = np.empty((0, 0, objects * runs))
        self._used = np.zeros((1 + CHUNK, objects * runs), dtype=bool)
        self._due = self._used.copy()
        self._measurement = self._dof = self._waiting = 0

    def add(self, white: Array | None, used: Mask, due: Mask) -> None:
        """Add the whitened innovations ``(m, batch)`` of the next measurement; None if the tracker gives none.

        ``used`` ``(batch,)`` masks the innovations that count, ``due`` ``(batch,)`` those that should exist.
        """
        if white is None and not self._dof:
            self._per_step[NIS["missing"], self._measurement] = due.sum()
            self._per_run[NIS["missing"]] += due.reshape(self._shape).sum(axis=0)
            self._measurement += 1
            return
        if white is not None and not self._dof:
            self._dof = len(white)
            self._white = np.zeros((len(self._used), self._dof, self._used.shape[1]))
        self._waiting += 1
        row = self._waiting
        self._white[row] = 0.0 if white is None else white
        self._used[row] = False if white is None else used
        self._due[row] = due
        if row == CHUNK:
            self.flush()

    @property
    def known(self) -> bool:
        """Whether an innovation was added, so that its number of components is known."""
        return self._dof > 0

    def latest(self) -> tuple[Array, Mask]:
        """Return the whitened innovations ``(m, batch)`` of the latest measurement, and a mask of the scored ones."""
        self.flush()
        return self._white[0], self._used[0]

    def take_sums(self, per_step: Array, per_run: Array, white: Array, used: Mask) -> None:
        """Add sums over the next measurements; ``white``, ``used``: whitened innovations of the last; scored."""
        count = per_step.shape[1]
        self._per_step[:, self._measurement : self._measurement + count] = per_step
        self._per_run += per_run
        self._measurement += count
        self._white[0], self._used[0] = white, used

    def flush(self) -> None:
        rows, before = slice(1, 1 + self._waiting), slice(self._waiting)
        if not self._waiting:
            return
        inputs = {
            "white": self._white[rows].swapaxes(0, 1),
            "used": self._used[rows],
            "white_before": self._white[before].swapaxes(0, 1),
            "used_before": self._used[before],
            "due": self._due[rows],
        }
        values = self._compute(INNOVATION, inputs)["rows"]
        per_run = values.sum(axis=1).reshape(len(values), *self._shape).sum(axis=1)
        self.take_sums(values.sum(axis=-1), per_run, self._white[self._waiting], self._used[self._waiting])
        self._waiting = 0

    def scores(self, stretches: int = 0) -> NisScores:
        """Return the sums over all measurements; ``stretches``: number of stretches of a single run, else 0."""
        self.flush()
        per_part = self._per_run
        if stretches:
            count = self._per_step.shape[1]
            per_part = added(self._per_step, np.arange(count) * stretches // max(count, 1))
        return NisScores(self._dof, self._per_step, self._per_run, per_part)

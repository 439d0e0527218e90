"""The sums of a trial with known identities: errors, and log-likelihoods of innovations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.protocol import Chunk, Innovation, Metric, Scope
from trackbench.metrics.sums import SHORTEST, STRETCHES, stretch_numbers
from trackbench.subjects.tuning.measures import OF_ALL

#: Shortest time at the beginning of a stretch that is scored neither for tuning nor for the test, s.
GAP = 1.0
#: Where a tracker gives an innovation, ``(scans, objects * runs)`` by sensor.
#: A filter decides before the measurement whether it gives an innovation. The likelihood of these innovations is
#: therefore a partial likelihood (Cox 1975, "Partial likelihood", Biometrika 62(2)), whose expectation is largest at
#: the true values.
Availability = dict[str, Mask]


class LogTime(NamedTuple):
    """Division of a single run into stretches of time that are scored separately.

    Stretches for tuning and for the test alternate, so that both see all conditions of the log.
    """

    gap: float
    """Unscored time at the beginning of each stretch, s: the time that a track needs to settle."""
    held_out: bool | None = None
    """True scores the held-out stretches, False the stretches for tuning, None the whole log."""

    @property
    def shortest(self) -> float:
        """Shortest duration of a log that can be divided into tuning and test, s."""
        return 2 * (SHORTEST + self.gap)

    def stretch(self, time: Array) -> Indices:
        """Return each instant's stretch number ``(instants,)``, -1 for an unscored instant; ``time`` is in s."""
        duration = float(time[-1] - time[0])
        if self.held_out is None:
            return stretch_numbers(len(time), duration)
        count = min(2 * STRETCHES, int(duration / (SHORTEST + self.gap)))
        position = (time - time[0]) / duration * count
        number = np.minimum(position.astype(np.intp), count - 1)
        scored = (number % 2 == int(self.held_out)) & ((position - number) * duration / count >= self.gap)
        return np.where(scored, number // 2, -1)


class TrialSums(Metric):
    """Accumulator of the total and number of each measure's terms in a trial; not a metric of a result."""

    name, unit, meaning, of_density = "trial", "1", "sums of a trial", True
    log_time: Any = None
    """``LogTime`` that divides a single run into stretches, each with its own sums; None to sum whole runs."""
    counted: Any = None
    """``Availability`` of the start; only innovations that the start gives are summed. None sums all innovations."""

    def init(self, scope: Scope) -> _Summing:
        stretch = None if self.log_time is None else self.log_time.stretch(scope.labelled.time)
        return _Summing(scope, stretch, self.counted)

    def update(self, sums: _Summing, chunk: Chunk) -> _Summing:
        sums.add(chunk)
        return sums

    def close(self, sums: _Summing) -> tuple[dict[str, Array], Availability]:
        """Return total and number ``(2, runs or stretches)`` by measure, and which innovations were summed."""
        return sums.values, {sensor: np.array(rows) for sensor, rows in sums.available.items()}

    def finish(self, sums: Any) -> None:
        return None


class _Summing:
    """Sums of a block while its scans are processed."""

    def __init__(self, scope: Scope, stretch: Indices | None, counted: Availability | None) -> None:
        self._shape = scope.labelled.alive.shape[1], scope.runs
        self._stretch, self._counted = stretch, counted
        parts = scope.runs if stretch is None else int(stretch.max()) + 1
        self.values = {name: np.zeros((2, parts)) for name in OF_ALL}
        self.available: dict[str, list[Mask]] = {sensor: [] for sensor in scope.measurements}

    def add(self, chunk: Chunk) -> None:
        """Add the errors of some instants; a missing estimate adds an error, as in a run, but no NEES."""
        instants, scored = chunk.instants, chunk.scored
        self._add("position_rmse", instants, chunk.squares[0], scored)
        self._add("velocity_rmse", instants, chunk.squares[1], scored)
        self._add("nees", instants, chunk.nees, scored & chunk.given)
        for sensor, innovations in chunk.innovations.items():
            for innovation in innovations:
                self._add_innovation(innovation, sensor)

    def _add_innovation(self, innovation: Innovation, sensor: str) -> None:
        density, rows, instant = innovation.log_density, self.available[sensor], innovation.instant
        if density is None:
            rows.append(np.zeros_like(innovation.used))
            return
        summed = innovation.used & ~np.isnan(density)
        if self._counted is not None:
            summed = summed & self._counted[sensor][len(rows)]
        rows.append(summed)
        self._add("log_likelihood", slice(instant, instant + 1), density[None], summed[None])

    def _add(self, name: str, instants: slice, values: Array, where: Mask) -> None:
        for total, terms in zip(self.values[name], (np.where(where, values, 0.0), where), strict=True):
            per_instant = terms.reshape(-1, *self._shape).sum(axis=1)
            if self._stretch is None:
                total += per_instant.sum(axis=0)
            else:
                stretch = self._stretch[instants]
                np.add.at(total, stretch[stretch >= 0], per_instant[stretch >= 0, 0])

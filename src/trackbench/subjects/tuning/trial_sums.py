"""Sums of a trial of a tracker of labelled objects: its errors, and the log-likelihoods of its innovations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.protocol import Chunk, Innovation, Metric, Scope
from trackbench.metrics.sums import SHORTEST, STRETCHES, stretch_numbers
from trackbench.subjects.tuning.measures import OF_ALL

#: Shortest time at the beginning of a stretch that counts neither for tuning nor for trying, s.
GAP = 1.0
#: By sensor, where a tracker gives an innovation, ``(scans, objects * runs)``.
#: Whether a filter gives an innovation is settled before the measurement comes, so that a likelihood of these alone is
#: a partial likelihood (Cox 1975, "Partial likelihood", Biometrika 62(2)): its expectation is largest at the true
#: values.
Availability = dict[str, Mask]


class LogTime(NamedTuple):
    """The stretches of time of a single run that are scored, each by itself.

    Held-out stretches alternate with those that are tuned on, so that both have whatever the log has at all times.
    """

    gap: float
    """At the beginning of each stretch, s: as long as a track needs to settle."""
    held_out: bool | None = None
    """Whether it is the stretches that are held out, or those that are tuned on; None: the whole log."""

    @property
    def shortest(self) -> float:
        """Shortest duration of a log of which a part can be held out, s."""
        return 2 * (SHORTEST + self.gap)

    def stretch(self, time: Array) -> Indices:
        """Return the number of the stretch of each instant ``(instants,)``, -1 where it does not count.

        Args:
            time: ``(instants,)`` s.
        """
        duration = float(time[-1] - time[0])
        if self.held_out is None:
            return stretch_numbers(len(time), duration)
        count = min(2 * STRETCHES, int(duration / (SHORTEST + self.gap)))
        place = (time - time[0]) / duration * count
        number = np.minimum(place.astype(np.intp), count - 1)
        scored = (number % 2 == int(self.held_out)) & ((place - number) * duration / count >= self.gap)
        return np.where(scored, number // 2, -1)


class TrialSums(Metric):
    """Total and number of the terms of each measure of a trial; not a metric of a result."""

    name, unit, meaning, of_density = "trial", "1", "sums of a trial", True
    log_time: Any = None
    """``LogTime`` of a single run, each of whose stretches is summed in place of the run; None for whole runs."""
    counted: Any = None
    """``Availability`` of the start, whose innovations alone are summed; None for all innovations."""

    def init(self, scope: Scope) -> _Summing:
        stretch = None if self.log_time is None else self.log_time.stretch(scope.labelled.time)
        return _Summing(scope, stretch, self.counted)

    def update(self, sums: _Summing, chunk: Chunk) -> _Summing:
        sums.add(chunk)
        return sums

    def close(self, sums: _Summing) -> tuple[dict[str, Array], Availability]:
        """Return ``(2, runs or stretches)`` total and number by measure, and the innovations that were summed."""
        return sums.values, {sensor: np.array(rows) for sensor, rows in sums.available.items()}

    def finish(self, sums: Any) -> None:
        return None


class _Summing:
    """The sums of a block that is under way."""

    def __init__(self, scope: Scope, stretch: Indices | None, counted: Availability | None) -> None:
        self._shape = scope.labelled.alive.shape[1], scope.runs
        self._stretch, self._counted = stretch, counted
        parts = scope.runs if stretch is None else int(stretch.max()) + 1
        self.values = {name: np.zeros((2, parts)) for name in OF_ALL}
        self.available: dict[str, list[Mask]] = {sensor: [] for sensor in scope.measurements}

    def add(self, chunk: Chunk) -> None:
        """Add the errors of some instants; a missing estimate is charged as in a run, and has no NEES."""
        here, scored = chunk.instants, chunk.scored
        self._add("position_rmse", here, chunk.squares[0], scored)
        self._add("velocity_rmse", here, chunk.squares[1], scored)
        self._add("nees", here, chunk.nees, scored & chunk.given)
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

    def _add(self, name: str, here: slice, values: Array, where: Mask) -> None:
        """Add values ``(instants, batch)``."""
        for total, terms in zip(self.values[name], (np.where(where, values, 0.0), where), strict=True):
            per_instant = terms.reshape(-1, *self._shape).sum(axis=1)
            if self._stretch is None:
                total += per_instant.sum(axis=0)
            else:
                stretch = self._stretch[here]
                np.add.at(total, stretch[stretch >= 0], per_instant[stretch >= 0, 0])

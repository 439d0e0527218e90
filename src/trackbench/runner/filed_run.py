"""Tracks that another program wrote, scored beside the trackers that take the scans of a block of runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackbench.base.errors import InputError
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic.assignment import count_by_gospa, nearby
from trackbench.runner.filed_tracks import at_instants, inside, offset_sums, rows_of_run, truth_at, why_other_scans
from trackbench.runner.hidden_run import HiddenRun, TrafficScores
from trackbench.truth.config.filed import TracksConfig


class FiledRun(HiddenRun):
    """Tracks of a file: they are there before the first scan, and nothing is driven."""

    def advance(self) -> None:
        """Take them all at the first instant."""
        if self._outcome is None:
            self._offsets: list[np.ndarray] = []
            self._counts = np.zeros(3, dtype=np.intp)
            self._outcome = self._scored()

    def _scored(self) -> TrafficScores:
        outcome = super()._scored()
        outcome.offset = np.concatenate(self._offsets, axis=1)
        outcome.filed = self._counts
        return outcome

    def _histories(self) -> Callable[[int], tuple[TruthHistory, TrackHistory]]:
        config = self._work.trackers[self.name]
        assert isinstance(config, TracksConfig)
        every = self._work.filed[self.name]
        shift = float(every.start - self._truth.start) + config.time_offset_s

        def histories(run: int) -> tuple[TruthHistory, TrackHistory]:
            number = self._piece.runs.start + run
            rows = rows_of_run(every, self._piece.scene, number)
            problem = why_other_scans(rows, self._hidden.digests[run].hex()[:16])
            if problem is not None:
                where = f"scene {self._piece.scene}, run {number}"
                raise InputError(f"{where}: {problem}", file=config.path, key=f"trackers.{self.name}")
            there = inside(rows, shift, self._truth.time[0], self._truth.time[-1])
            self._counts += len(rows), there.sum(), not there.any()
            history, stamp = at_instants(rows, self._time, shift)
            truth = truth_at(self._truth, number, self._truth_of(run), stamp)
            near = nearby(truth, history, self._work.cutoff or 0.0)
            self._offsets.append(offset_sums(truth, history, count_by_gospa(near).matched))
            return truth, history

        return histories

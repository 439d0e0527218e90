"""The recorded run as arrays, out of its tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.metrics import Target
from trackbench.metrics.conditions import FIRST
from trackbench.metrics.intervals import ROUNDING
from trackbench.results import Result
from trackbench.results.columns import Columns, split, table_columns

STATE = ("px_m", "py_m", "vx_mps", "vy_mps")


@dataclass(frozen=True)
class RecordedTrack:
    """One tracker's estimates."""

    mean: Array
    """``(4, instants, objects)``, NaN where there is none."""
    covariance: Array
    """``(4, 4, instants, objects)``"""
    position_error: Array
    """``(instants, objects)`` m."""
    velocity_error: Array
    """``(instants, objects)`` m/s."""
    nees: Array
    """``(instants, objects)``"""
    due: Mask
    """``(instants, objects)`` where an estimate counts."""
    starting: Mask
    """``(instants, objects)`` where the track starts: the first second after the object is known."""


@dataclass(frozen=True)
class RecordedRun:
    """The recorded run at each instant of a measurement."""

    objects: tuple[str, ...]
    time: Array
    """``(instants,)`` s."""
    state: Array
    """``(4, instants, objects)`` the true px, py, vx, vy."""
    alive: Mask
    """``(instants, objects)``"""
    divergence: float
    """m"""
    tracks: dict[str, RecordedTrack]
    """By tracker, those that did not fail."""

    def target(self, tracker: str) -> Target:
        """What a tracker is held against; without a reference, which needs the sensors' models."""
        due, no_reference = self.tracks[tracker].due[..., None], np.zeros((2, len(self.time), 1, 1))
        state, starting = self.state[..., None], np.zeros_like(due)
        return Target(self.time, state, self.alive, due, starting, self.divergence, no_reference)


def load_recorded_run(result: Result) -> RecordedRun:
    """The recorded run, from the first to the last instant of a measurement."""
    tables, score = result.tables, result.summary.score
    objects = tuple(result.summary.truth.objects)
    truth = {name: rows for (role, name), rows in split(tables.truth, "role", "object").items() if role == "target"}
    tracks: dict[str, dict[str, Columns]] = {}
    for (tracker, name), rows in split(tables.estimates, "tracker", "object").items():
        tracks.setdefault(tracker, {})[name] = rows
    every = [rows["time_s"] for track in tracks.values() for rows in track.values()]
    time = every[0] if every else np.unique(table_columns(tables.measurements)["time_s"])
    at = np.searchsorted(truth[objects[0]]["time_s"], time)
    state = np.stack([np.stack([truth[name][column][at] for name in objects], axis=1) for column in STATE])
    alive = np.stack([truth[name]["alive"][at] for name in objects], axis=1).astype(bool)
    start = max(0.0, FIRST - score.settle_s)
    by_tracker = {tracker: _track(rows, objects, time, start) for tracker, rows in tracks.items()}
    return RecordedRun(objects, time, state, alive, score.divergence_m, by_tracker)


def _track(rows: dict[str, Columns], objects: tuple[str, ...], time: Array, start: float) -> RecordedTrack:
    """``start``: how long a track starts after its estimates begin to count, s."""

    def column(name: str) -> Array:
        values = np.full((len(time), len(objects)), np.nan)
        for i, key in enumerate(objects):
            if key in rows:
                values[:, i] = rows[key][name]
        return values

    due = column("due") > 0
    begins = due & ~np.vstack([np.zeros_like(due[:1]), due[:-1]])
    since = np.maximum.accumulate(np.where(begins, time[:, None], -np.inf), axis=0)
    covariance = [[column(f"p_{min(a, b)}{max(a, b)}") for b in range(4)] for a in range(4)]
    return RecordedTrack(
        mean=np.stack([column(name) for name in STATE]),
        covariance=np.stack([np.stack(row) for row in covariance]),
        position_error=column("position_error_m"),
        velocity_error=column("velocity_error_mps"),
        nees=column("nees"),
        due=due,
        starting=due & (time[:, None] - since < start * (1 - ROUNDING)),
    )

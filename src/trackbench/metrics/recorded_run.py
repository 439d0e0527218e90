"""The recorded run as arrays, out of its tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.metrics import Target
from trackbench.results import Result
from trackbench.results.columns import Columns, columns, split
from trackbench.types import Array, Mask

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


@dataclass(frozen=True)
class RecordedRun:
    """The recorded run at each instant of a measurement."""

    objects: tuple[str, ...]
    target: Target
    tracks: dict[str, RecordedTrack]
    """By tracker, those that did not fail."""

    @property
    def scored(self) -> Mask:
        """``(instants, objects)`` where an estimate counts."""
        late = self.target.time[:, None] >= self.target.start[:, 0]
        return np.asarray(self.target.alive & late)


def recorded_run(result: Result) -> RecordedRun:
    """The recorded run, from the first to the last instant of a measurement."""
    tables, score = result.tables, result.summary.score
    objects = tuple(result.summary.truth.objects)
    truth = {name: rows for (role, name), rows in split(tables.truth, "role", "object").items() if role == "target"}
    time = np.unique(columns(tables.measurements)["time_s"])
    at = np.searchsorted(truth[objects[0]]["time_s"], time)
    state = np.stack([np.stack([truth[name][column][at] for name in objects], axis=1) for column in STATE])
    alive = np.stack([truth[name]["alive"][at] for name in objects], axis=1).astype(bool)
    start = np.full((len(objects), 1), np.inf)
    for (name,), rows in split(tables.measurements, "object").items():
        valid = rows["valid"].astype(bool)
        if valid.any():
            start[objects.index(name)] = rows["time_s"][valid][0] + score.settle_s
    target = Target(time, state[..., None], alive, start, score.divergence_m, np.zeros((2, len(time), 1, 1)))
    tracks: dict[str, dict[str, Columns]] = {}
    for (tracker, name), rows in split(tables.estimates, "tracker", "object").items():
        tracks.setdefault(tracker, {})[name] = rows
    return RecordedRun(objects, target, {tracker: _track(rows, objects, time) for tracker, rows in tracks.items()})


def _track(rows: dict[str, Columns], objects: tuple[str, ...], time: Array) -> RecordedTrack:
    def column(name: str) -> Array:
        values = np.full((len(time), len(objects)), np.nan)
        for i, key in enumerate(objects):
            if key in rows:
                values[np.searchsorted(time, rows[key]["time_s"]), i] = rows[key][name]
        return values

    covariance = [[column(f"p_{min(a, b)}{max(a, b)}") for b in range(4)] for a in range(4)]
    return RecordedTrack(
        mean=np.stack([column(name) for name in STATE]),
        covariance=np.stack([np.stack(row) for row in covariance]),
        position_error=column("position_error_m"),
        velocity_error=column("velocity_error_mps"),
        nees=column("nees"),
    )

"""The scans of an episode, made while it goes on: bit for bit those that the whole motion would give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Scan
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Sensor
from trackbench.models.sensors.effects import Bodies
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import IdealSensor, ideal_sensor
from trackbench.sensing.view import firing_steps
from trackbench.truth.driven import LatestTruth

#: By array of ``IdealSensor`` and of ``Bodies``, the axis of its instants.
INSTANTS = {
    "measurement": 1,
    "visible": 0,
    "in_view": 0,
    "probability": 0,
    "pose": 1,
    "velocity": 1,
    "polar": 1,
    "scale": 1,
    "target": 1,
    "centre": 1,
    "heading": 0,
    "axis": 1,
    "yaw_rate": 0,
}
#: Times of the truth differ by more, s.
CLOSE = 1e-6


class SensedScan(NamedTuple):
    """A scan with what no tracker may know."""

    scan: Scan
    """``measurement`` ``(m, D, 1)``."""
    origins: Indices
    """``(2, D, 1)`` the object of each detection, and the second one of a merged detection."""


class EpisodeSensing:
    """The sensors of an episode.

    The noise of the whole episode is drawn each time, for the instants that it may have at most: what is drawn for an
    instant does not depend on when the agent decides, and effects of a sensor keep their memory.

    Args:
        sensors: by name.
        time: ``(steps,)`` of the longest possible episode, s.
        seed: of the noise.
        name: of the scenario.
        run: number of the episode.
    """

    def __init__(self, sensors: Mapping[str, Sensor], time: Array, seed: int, name: str, run: int) -> None:
        self._sensors, self._seed, self._name, self._run = sensors, seed, name, run
        self._time = time
        self._steps = {name: firing_steps(config, time) for name, config in sensors.items()}
        self._ideal: dict[str, IdealSensor] = {}
        self._latest = -np.inf
        self._on_their_way: list[SensedScan] = []

    def arrived(self, latest: LatestTruth) -> list[SensedScan]:
        """The scans that have arrived since the last call, in the order in which they did."""
        for name, config in self._sensors.items():
            self._note(name, config, latest)
        now = float(latest.truth.time[-1])
        with np.errstate(invalid="ignore"):
            # What is to come is NaN.
            hidden = sense_hidden([*self._ideal.values()], self._seed, self._name, range(self._run, self._run + 1))
        self._on_their_way += [
            SensedScan(scan, np.stack([origins, merged]))
            for scan, origins, merged in zip(hidden.scans, hidden.origins, hidden.merged, strict=True)
            if self._latest + CLOSE < scan.time <= now + CLOSE
        ]
        self._latest = now
        there = [item for item in self._on_their_way if item.scan.arrival_time <= now + CLOSE]
        self._on_their_way = [item for item in self._on_their_way if item.scan.arrival_time > now + CLOSE]
        return sorted(there, key=lambda item: (item.scan.arrival_time, item.scan.time))

    def _note(self, name: str, config: Sensor, latest: LatestTruth) -> None:
        """Add what one sensor would read without noise at its instants of what is new."""
        steps = self._steps[name]
        last = latest.first + len(latest.truth.time) - 1
        there = np.flatnonzero((steps >= latest.new) & (steps <= last))
        part, whole = ideal_sensor(latest.truth, name, config, steps[there] - latest.first), self._ideal.get(name)
        changes = _placed(whole, part, len(steps), there)
        if part.bodies is not None:
            bodies = None if whole is None else whole.bodies
            placed = _placed(bodies, part.bodies, len(steps), there)
            points = {name: by_arithmetic(placed[name]) for name in ("target", "centre")}
            changes["bodies"] = replace(part.bodies, **{**placed, **points})
        self._ideal[name] = replace(part, steps=steps, time=self._time[steps], **changes)


def _placed(
    whole: IdealSensor | Bodies | None, part: IdealSensor | Bodies, instants: int, there: Indices
) -> dict[str, Any]:
    """The arrays of ``whole``, with those of ``part`` at some of its instants; NaN and False where nothing is known."""
    result = {}
    for name, axis in INSTANTS.items():
        new = getattr(part, name, None)
        if new is None:
            continue
        shape = (*new.shape[:axis], instants, *new.shape[axis + 1 :])
        values = np.full(shape, False if new.dtype == bool else np.nan)
        if whole is not None:
            known = getattr(whole, name)
            # Objects may have come.
            values[tuple(map(slice, known.shape))] = known
        values[(slice(None),) * axis + (there,)] = new
        result[name] = values
    return result

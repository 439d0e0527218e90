"""Scans of an episode in progress, bit for bit equal to the scans made after its end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Scan, Truth, scan_of_run
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Sensor
from trackbench.models.sensors.effects import Bodies
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import IdealSensor, ideal_sensor, sense_known
from trackbench.sensing.view import firing_steps

#: Axis of the instants in each array of ``IdealSensor`` and of ``Bodies``, by the array's name.
INSTANTS = {
    **dict.fromkeys(("visible", "in_view", "probability", "yaw_rate", "heading"), 0),
    **dict.fromkeys(("measurement", "pose", "velocity", "polar", "target", "centre", "axis"), 1),
}


class EpisodeSensing:
    """Sensors in an episode whose motion becomes known step by step.

    Each call of :meth:`arrived` draws the noise of the longest possible episode from its start. So the noise at an
    instant does not depend on earlier calls, and an effect with memory is the same in every call.

    Args:
        sensors: sensors by name.
        time: ``(steps,)`` times of the longest possible episode, s.
        seed: seed of the noise.
        scenario: name of the scenario, which the noise depends on too.
        hidden: whether identities are hidden.
    """

    def __init__(self, sensors: Mapping[str, Sensor], time: Array, seed: int, scenario: str, hidden: bool) -> None:
        self._sensors, self._time, self._hidden = sensors, time, hidden
        self._noise = seed, scenario, range(1)
        self._steps = {name: firing_steps(config, time) for name, config in sensors.items()}
        self._ideal: dict[str, IdealSensor] = {}
        self._known_steps, self._latest = 0, -np.inf
        self._on_their_way: list[Scan] = []

    def arrived(self, truth: Truth) -> list[Scan]:
        """Return the scans that have arrived since the previous call, in the order of their arrival.

        Args:
            truth: ground truth from the start of the episode to now, its last step.
        """
        for name, config in self._sensors.items():
            self._add_known_instants(name, config, truth)
        self._known_steps = len(truth.time)
        ideal, now = [*self._ideal.values()], float(truth.time[-1]) + SAME_TIME
        with np.errstate(invalid="ignore"):  # Future instants are NaN.
            sense = sense_hidden if self._hidden else sense_known
            new = [scan for scan in sense(ideal, *self._noise).scans if self._latest < scan.time <= now]
        self._on_their_way += [scan_of_run(scan, 0) for scan in new] if self._hidden else new
        self._latest = now
        arrived = [scan for scan in self._on_their_way if scan.arrival_time <= now]
        self._on_their_way = [scan for scan in self._on_their_way if scan.arrival_time > now]
        return sorted(arrived, key=lambda scan: (scan.arrival_time, scan.time))

    def _add_known_instants(self, name: str, config: Sensor, truth: Truth) -> None:
        steps, whole = self._steps[name], self._ideal.get(name)
        instants = np.flatnonzero((steps >= self._known_steps) & (steps < len(truth.time)))
        part = ideal_sensor(truth, name, config, steps[instants])
        arrays = _with_instants(whole, part, len(steps), instants)
        if part.bodies is not None:
            bodies = _with_instants(None if whole is None else whole.bodies, part.bodies, len(steps), instants)
            points = {name: by_arithmetic(bodies[name]) for name in ("target", "centre")}
            arrays["bodies"] = replace(part.bodies, **{**bodies, **points})
        self._ideal[name] = replace(part, steps=steps, time=self._time[steps], **arrays)


def _with_instants(
    whole: IdealSensor | Bodies | None, part: IdealSensor | Bodies, count: int, instants: Indices
) -> dict[str, Any]:
    """Return the arrays of ``whole`` with ``instants`` (indices) taken from ``part``; unknown ones are NaN or False."""
    result = {}
    for name, axis in INSTANTS.items():
        new = getattr(part, name, None)
        if new is None:
            continue
        shape = (*new.shape[:axis], count, *new.shape[axis + 1 :])
        values = np.full(shape, False if new.dtype == bool else np.nan)
        if whole is not None:
            known = getattr(whole, name)
            # New objects may have appeared.
            values[tuple(map(slice, known.shape))] = known
        values[(slice(None),) * axis + (instants,)] = new
        result[name] = values
    return result

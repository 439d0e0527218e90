"""Interference by other radars in the same band."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array, Indices, Mask
from trackbench.models.sensors.effects.base import Effect, Sensed
from trackbench.models.sensors.model import SensorModel

#: Mean durations before the first instant in which bursts are drawn; all but 5e-5 of older bursts have ended.
LONGEST_BURST = 10.0


class Interference(Effect):
    """Bursts of interference at random times: a Poisson process with exponentially distributed durations.

    In a burst P_D is lower, and with hidden identities there are more false alarms.
    """

    one_of: ClassVar[tuple[str, ...]] = ("detection_factor", "alarms_per_scan")

    per_minute: float = Field(gt=0, le=6000, description="Mean number of bursts per minute.")
    duration_s: float = Field(gt=0, le=60, description="Mean duration of a burst, s.")
    detection_factor: float = Field(1, ge=0, le=1, description="Factor of the detection probability in a burst.")
    alarms_per_scan: float = Field(
        0, ge=0, le=1000, description="Mean number of further false alarms per scan in a burst, uniform in view."
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        burst = np.stack([self._draw_bursts(sensed.time, generator) for generator in random.each], axis=-1)[:, None]
        return sensed.replaced(probability=np.where(burst, self.detection_factor, 1.0) * sensed.probability)

    def alarms(self, sensed: Sensed, random: RunStreams) -> tuple[Indices, Indices, Array]:
        instants, shares = [], []
        for generator in random.each:
            burst = np.flatnonzero(self._draw_bursts(sensed.time, generator))
            instants.append(np.repeat(burst, generator.poisson(self.alarms_per_scan, len(burst))))
            shares.append(generator.random((len(sensed.error), len(instants[-1]))))
        run = np.repeat(np.arange(sensed.runs), [len(instant) for instant in instants])
        return run, np.concatenate(instants), sensed.sensor.uniform(np.concatenate(shares, axis=1))

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        if self.alarms_per_scan and not sensor.has_volume():
            yield Problem(("alarms_per_scan",), f"a {sensor.kind()} has no uniform clutter; remove it")
        elif self.alarms_per_scan and sensor.max_range_m is None:
            yield Problem(("alarms_per_scan",), "needs a limited range: state max_range_m of the sensor")

    def _draw_bursts(self, time: Array, random: np.random.Generator) -> Mask:
        begin, end = time[0] - LONGEST_BURST * self.duration_s, time[-1]
        count = random.poisson(self.per_minute * (end - begin) / 60.0)
        first = np.sort(random.uniform(begin, end, count))
        until = np.maximum.accumulate(first + random.exponential(self.duration_s, count))
        latest = np.searchsorted(first, time, side="right") - 1
        return np.asarray((latest >= 0) & (time < np.append(until, -np.inf)[latest]))

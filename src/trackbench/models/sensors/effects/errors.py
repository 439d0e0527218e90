"""Errors that are not white: biases, slowly changing errors, and rounding to whole steps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import NonNegative, Positive, Probability, Problem
from trackbench.base.streams import RunStreams
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.models.sensors.effects.base import Effect, Sensed, by_component, component_problems
from trackbench.models.sensors.effects.processes import gauss_markov
from trackbench.models.sensors.model import SensorModel


class CorrelatedErrors(Effect):
    """Slowly changing part of the sensor's noise, a Gauss-Markov process for each component and vehicle.

    The total variance stays as the options state it; only errors at different instants become correlated. Where
    ``signal_to_noise`` draws a received power at each scan, only the white noise depends on it.
    """

    share: float = Field(gt=0, le=1, description="Share of the noise variance that changes slowly.")
    share_of: dict[str, Probability] = Field(
        default_factory=dict, description="Shares of single components, such as `range_rate: 0.8`."
    )
    time_s: Positive = Field(description="Correlation time of the process, to 1/e, s.")
    order: Literal[1, 2] = Field(
        2, description="Order of the process: 2 changes smoothly; 1 is the order that trackers can assume."
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        instants, objects = sensed.shape
        white = random.standard_normal((instants, len(sensed.error), objects))
        slow = np.moveaxis(gauss_markov(sensed.time, self.time_s, white, self.order), 1, 0)
        names = sensed.sensor.components if self.share_of else ("all",)
        shares = np.array([self.share_of.get(name, self.share) for name in names])[:, None, None, None]
        slow *= np.sqrt(shares) * sensed.sigmas() * sensed.slow_scale
        slow += sensed.error
        rest = np.sqrt(1.0 - shares)
        return sensed.replaced(error=slow, scale=rest * sensed.scale, slow_scale=rest * sensed.slow_scale)

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        for name in self.share_of:
            if wrong := sensor.why_unmeasured(name):
                yield Problem(("share_of", name), wrong)


class Bias(Effect):
    """Error that is drawn once per run and stays constant, such as the error of a misaligned mount."""

    sigmas: dict[str, NonNegative] = Field(
        min_length=1, description="Standard deviation by component, such as `azimuth_deg: 0.3`."
    )

    def before(self, sensed: Sensed, random: RunStreams) -> Sensed:
        sigmas = by_component(self.sigmas, sensed.sensor)
        constant = sigmas[:, None] * random.standard_normal(len(sigmas))
        return sensed.replaced(error=sensed.error + constant[:, None, None])

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        return component_problems("sigmas", self.sigmas, sensor)


class Quantised(Effect):
    """Rounding of each measured component to whole multiples of a step."""

    steps: dict[str, Positive] = Field(min_length=1, description="Step by component, such as `range_m: 0.2`.")

    def after(self, measurement: Array, sensor: SensorModel) -> Array:
        step = by_component(self.steps, sensor)
        result = measurement.copy()
        for i in np.flatnonzero(step):
            whole = np.rint(measurement[i] / step[i], out=result[i])
            whole *= step[i]
            if i in sensor.angular:
                whole[...] = wrap_angle(whole)
        return result

    def problems_on(self, sensor: SensorModel) -> Iterator[Problem]:
        return component_problems("steps", self.steps, sensor)

"""What a tracker takes in place of what a sensor states, and what it assumes of a sensor's effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import Config, NonNegative, Positive, Problem
from trackbench.base.config.key_units import in_si, split_key
from trackbench.base.types import Array, Scan
from trackbench.filters import ErrorState
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.effects.base import component_problems
from trackbench.models.sensors.effects.signal import SignalRange

#: What is nearer, or measured to be, has the signal of this distance, m.
NEAREST = 1.0


class ErrorProcess(Config):
    """Errors that change slowly, as part of the state: a first-order Gauss-Markov process for each component."""

    components: list[str] = Field(
        min_length=1, description="Components of the measurement that have them, such as [range, azimuth, range_rate]."
    )
    share: float = Field(gt=0, lt=1, description="Their share of the noise variance; the rest is white.")
    time_s: Positive = Field(description="Time constant of the process, s.")


class ConstantErrors(Config):
    """Errors that stay, as part of the state."""

    sigmas: dict[str, NonNegative] = Field(
        min_length=1,
        description="Standard deviation of each before any measurement, by component, such as `azimuth_deg: 0.3`; "
        "beside the noise that the sensor states.",
    )


class AssumedEffects(Config):
    """Effects of a sensor that a tracker assumes."""

    signal_to_noise: SignalRange | None = Field(
        None,
        description="The noise of each measurement by its range, as the effect of this name has it on average over the "
        "fluctuating cross-section; with associate the detection probability too.",
    )
    correlated_errors: ErrorProcess | None = Field(
        None, description="Errors that change slowly, which are estimated with the motion of each object."
    )
    bias: ConstantErrors | None = Field(
        None, description="Errors that stay, which are estimated with the motion of each object."
    )

    @property
    def names(self) -> list[str]:
        """Of the effects, as sentences have them."""
        return [name.replace("_", " ") for name in type(self).model_fields if getattr(self, name) is not None]

    @property
    def states(self) -> list[str]:
        """The keys of those that are errors as part of the state."""
        return [key for key in ("correlated_errors", "bias") if getattr(self, key) is not None]

    def problems_on(self, kind: str, linear: bool) -> Iterator[Problem]:
        """What does not fit a kind of sensor.

        Args:
            kind: of sensor, by its name.
            linear: whether the filter converts measurements to positions, as the Kalman filter does, which changes
                their errors.
        """
        sensor = SENSOR_MODELS[kind]
        if self.signal_to_noise is not None and not sensor.measures_position():
            yield Problem(("signal_to_noise",), f"a {kind} measures no position, by which the signal falls; remove it")
        for key in self.states:
            if linear:
                yield Problem((key,), "kf converts measurements to positions, without errors as states; use ekf")
        if self.correlated_errors is not None:
            for i, name in enumerate(self.correlated_errors.components):
                if wrong := sensor.why_unmeasured(name):
                    yield Problem(("correlated_errors", "components", i), wrong)
                elif name in self.correlated_errors.components[:i]:
                    yield Problem(("correlated_errors", "components", i), f"{name} is named twice; remove one")
        if self.bias is not None:
            for problem in component_problems("sigmas", self.bias.sigmas, sensor):
                yield Problem(("bias", *problem.at), problem.message)

    def problems(self) -> Iterator[Problem]:
        if not self.names:
            yield Problem((), f"says nothing; add {' or '.join(type(self).model_fields)}")


def error_states(effects: Mapping[str, AssumedEffects]) -> tuple[ErrorState, ...]:
    """The errors that are part of the state, of effects by the sensor's name."""
    states = []
    for sensor, assumed in effects.items():
        if assumed.correlated_errors is not None:
            process = assumed.correlated_errors
            states += [ErrorState(sensor, name, 1 / process.time_s, process.share) for name in process.components]
        if assumed.bias is not None:
            sigmas = assumed.bias.sigmas.items()
            states += [ErrorState(sensor, split_key(key)[0], 0.0, sigma=in_si(key, value)) for key, value in sigmas]
    return tuple(states)


@dataclass(frozen=True)
class AssumedSensors:
    """The equations and the noise that a tracker takes in place of a sensor's own, by the sensor's name."""

    models: Mapping[str, str] = field(default_factory=dict)
    """The kind of sensor that it is taken for."""
    noise: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Standard deviations by the option that states them."""
    effects: Mapping[str, AssumedEffects] = field(default_factory=dict)

    def read(self, scan: Scan) -> Scan:
        """The scan as the tracker takes it, each measurement with its own noise."""
        return self.with_noise_by_range(self.stated(scan))

    def stated(self, scan: Scan) -> Scan:
        """The scan by the sensor and the noise that the tracker takes, alike at all ranges."""
        kind = self.models.get(scan.sensor, scan.kind)
        if kind != scan.kind:
            scan = scan._replace(kind=kind)
        sigmas = self.noise.get(scan.sensor)
        if sigmas is not None:
            scan = scan._replace(noise_covariance=SENSOR_MODELS[kind].other_noise(scan.noise_covariance, sigmas))
        return scan

    def with_noise_by_range(self, scan: Scan) -> Scan:
        """The scan, each measurement with the noise of its range where the tracker assumes that."""
        signal = self.signal(scan.sensor)
        if signal is None:
            return scan
        factor = np.where(scan.valid, signal.mean_variance_factor(measured_distance(scan)), 1.0)
        return scan._replace(noise_covariance=linalg.expand(scan.noise_covariance, scan.measurement[None]) * factor)

    def signal(self, sensor: str) -> SignalRange | None:
        """The signal-to-noise ratio that is assumed of a sensor."""
        return self.effects[sensor].signal_to_noise if sensor in self.effects else None


def measured_distance(scan: Scan) -> Array:
    """``(...)`` the distance that each measurement states, m; one where there is no measurement."""
    model = SENSOR_MODELS[scan.kind]
    if "range" in model.components:
        away = np.maximum(scan.measurement[model.components.index("range")], NEAREST)
    else:
        away = distance_from_sensor(model.position(scan).mean, scan)
    return np.where(scan.valid, away, NEAREST)


def distance_from_sensor(position: Array, scan: Scan) -> Array:
    """``(...)`` of positions ``(2, ...)`` from the sensor, m."""
    x, y = position - linalg.expand(scan.sensor_pose[:2], position)
    away: Array = np.maximum(np.hypot(x, y), NEAREST)
    return away

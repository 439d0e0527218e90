"""Sensor models, noise and sensor effects assumed by a tracker, in place of the stated ones."""

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

#: Smallest distance at which the signal is computed, m.
NEAREST = 1.0


class ErrorProcess(Config):
    """Slowly changing sensor errors in a tracker's state: a first-order Gauss-Markov process per component."""

    components: list[str] = Field(
        min_length=1,
        description="Components of the measurement with these errors, such as [range, azimuth, range_rate].",
    )
    share: float = Field(gt=0, lt=1, description="Share of these errors in the noise variance; the rest is white.")
    time_s: Positive = Field(description="Time constant of the process, s.")


class ConstantErrors(Config):
    """Constant sensor errors that a tracker estimates in its state."""

    sigmas: dict[str, NonNegative] = Field(
        min_length=1,
        description="Standard deviation of each before any measurement, by component, such as `azimuth_deg: 0.3`; "
        "beside the noise that the sensor states.",
    )


class AssumedEffects(Config):
    """Sensor effects that a tracker assumes for one sensor."""

    signal_to_noise: SignalRange | None = Field(
        None,
        description="Noise of each measurement that depends on its range as in the sensor effect of this name, "
        "averaged over the fluctuating cross-section; with associate the detection probability too.",
    )
    correlated_errors: ErrorProcess | None = Field(
        None, description="Errors that change slowly, which are estimated with the motion of each object."
    )
    bias: ConstantErrors | None = Field(
        None, description="Errors that stay, which are estimated with the motion of each object."
    )

    @property
    def names(self) -> list[str]:
        """Sensor effects that the tracker assumes, in words for messages and tables."""
        return [name.replace("_", " ") for name in type(self).model_fields if getattr(self, name) is not None]

    @property
    def states(self) -> list[str]:
        """Keys of the assumed effects (correlated_errors, bias) whose errors become part of the tracker's state."""
        return [key for key in ("correlated_errors", "bias") if getattr(self, key) is not None]

    def problems_on(self, kind: str, linear: bool) -> Iterator[Problem]:
        """Yield a problem for each assumed effect that a type of sensor, such as lidar, does not have.

        Args:
            kind: name of the type of sensor.
            linear: whether the filter converts measurements to positions, as the Kalman filter does.
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
            yield Problem((), f"is empty; add {' or '.join(type(self).model_fields)}")


def error_states(effects: Mapping[str, AssumedEffects]) -> tuple[ErrorState, ...]:
    """Return the sensor errors that become part of a tracker's state, from the assumed effects by sensor."""
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
    """Sensor models and noise that a tracker assumes, by the sensor's name."""

    models: Mapping[str, str] = field(default_factory=dict)
    """Type of sensor, such as radar, that the tracker assumes in place of the stated type, by the sensor's name."""
    noise: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Standard deviations by option that the tracker assumes for a sensor, by the sensor's name."""
    effects: Mapping[str, AssumedEffects] = field(default_factory=dict)

    def read(self, scan: Scan) -> Scan:
        """Return the scan with the assumed kind of sensor and the assumed noise, which may depend on the range."""
        return self.with_noise_by_range(self.stated(scan))

    def stated(self, scan: Scan) -> Scan:
        """Return the scan with the assumed kind of sensor, and assumed noise that does not depend on the range."""
        kind = self.models.get(scan.sensor, scan.kind)
        if kind != scan.kind:
            scan = scan._replace(kind=kind)
        sigmas = self.noise.get(scan.sensor)
        if sigmas is not None:
            scan = scan._replace(noise_covariance=SENSOR_MODELS[kind].other_noise(scan.noise_covariance, sigmas))
        return scan

    def with_noise_by_range(self, scan: Scan) -> Scan:
        """Return the scan with noise that depends on the range, if the tracker assumes so; else the scan unchanged."""
        signal = self.signal(scan.sensor)
        if signal is None:
            return scan
        factor = np.where(scan.valid, signal.mean_variance_factor(measured_distance(scan)), 1.0)
        return scan._replace(noise_covariance=linalg.expand(scan.noise_covariance, scan.measurement[None]) * factor)

    def signal(self, sensor: str) -> SignalRange | None:
        """Return the assumed dependence of a sensor's noise on the signal-to-noise ratio; None if not assumed."""
        return self.effects[sensor].signal_to_noise if sensor in self.effects else None


def measured_distance(scan: Scan) -> Array:
    """Return the distance ``(...)`` from the sensor that each measurement states, m; 1 for an invalid measurement."""
    model = SENSOR_MODELS[scan.kind]
    if "range" in model.components:
        distance = np.maximum(scan.measurement[model.components.index("range")], NEAREST)
    else:
        distance = distance_from_sensor(model.position(scan).mean, scan)
    return np.where(scan.valid, distance, NEAREST)


def distance_from_sensor(position: Array, scan: Scan) -> Array:
    """Return the distance ``(...)`` of positions ``(2, ...)`` from the sensor, m."""
    x, y = position - linalg.expand(scan.sensor_pose[:2], position)
    distance: Array = np.maximum(np.hypot(x, y), NEAREST)
    return distance

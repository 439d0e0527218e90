"""What a sensor is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, Tag, model_validator

from trackbench.base import linalg
from trackbench.base.config import (
    LARGEST_SIGMA,
    LEAST_SIGMA,
    LIST,
    NUMBER,
    Angle,
    Config,
    KeyPath,
    NonNegative,
    Positive,
    Probability,
    Problem,
    chosen_by,
    number_or_list,
    reject,
)
from trackbench.base.config.key_units import in_si, split_key
from trackbench.base.config.plugin import Plugin
from trackbench.base.errors import nearest_choices
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Gaussian, Mask, Scan
from trackbench.models.sensors.detection import ByAngle, Clutter, DetectionFactors, Resolution, StatedDetection
from trackbench.models.sensors.effects import EFFECTS, Effect
from trackbench.models.sensors.presets import WORDS, Words, of_components, presets, typical

#: A time for which a measurement is on its way, s.
Delay = Annotated[float, Field(ge=0, le=60)]


Latency = Annotated[
    Annotated[Delay, Tag(NUMBER)] | Annotated[list[Delay], Field(min_length=2, max_length=2), Tag(LIST)],
    chosen_by(number_or_list, "write a time, such as 0.1, or the least and the most, such as [0.05, 0.2]"),
]


def sensor_type(kind: str) -> str:
    """Return the type of the sensor whose scans are of a kind: "radar" of "radar(range, azimuth)"."""
    return kind.partition("(")[0]


class Mount(Config):
    """The sensor's pose on the observer."""

    x_m: float = Field(0, ge=-100, le=100, description="Forward of the observer's centre, m.")
    y_m: float = Field(0, ge=-100, le=100, description="Left of the observer's centre, m.")
    yaw_deg: Angle = Field(0, description="Direction of the boresight, counter-clockwise from straight ahead, degrees.")


class Dropout(Config):
    """An interval in which the sensor is silent."""

    from_s: NonNegative = Field(description="First instant without a measurement, s.")
    to_s: NonNegative = Field(description="First instant with measurements again, s.")

    def problems(self) -> Iterator[Problem]:
        if self.from_s >= self.to_s:
            yield Problem(("to_s",), f"must be later than from_s, which is {self.from_s:g}")


class Sensor(Config, ABC):
    """A sensor at a known pose and velocity that sees a target of Cartesian state px, py, vx, vy (fixed frame).

    The fields of a subclass are its options in a scenario, and its class methods the equations, which need no options.
    ``pose`` is ``(3, ...)`` x, y, yaw and ``velocity`` ``(2, ...)`` vx, vy of the sensor.
    """

    components: ClassVar[tuple[str, ...]]
    """Names of the measurement's components."""
    angular: ClassVar[tuple[int, ...]] = ()
    """Which components are angles."""
    units: ClassVar[tuple[str, ...]]
    """The unit of each in a measurement: "m", "rad", "m/s"."""
    sigma_options: ClassVar[tuple[str, ...]]
    """The option that is the standard deviation of each, its unit at the end: "azimuth_sigma_deg"."""
    pure: ClassVar[bool] = False
    """Whether the equations depend on their arguments alone, so that the fused engine may compile them. A class that
    inherits from one that says so has to say it again."""
    unused: ClassVar[tuple[str, ...]] = ()
    """Options that a preset may give and this kind does not use."""

    type: str = Field("", description="The kind of sensor.")
    preset: str | None = Field(
        None,
        description="A real sensor whose published figures are the defaults of the other keys "
        "(`trackbench list sensors` shows them).",
    )
    rate_hz: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="Measurements per second, Hz; it divides truth.rate_hz. Required, but not where they are recorded.",
    )
    phase_s: NonNegative = Field(
        0, description="Time of the first measurement, s; a whole number of truth steps, shorter than a period."
    )
    mount: Mount = Field(default_factory=Mount, description="Pose on the observer.")
    fov_deg: float = Field(
        360, gt=0, le=360, description="Full horizontal field of view, centred on the boresight, degrees."
    )
    max_range_m: Positive | None = Field(
        None, description="Beyond this range nothing is detected, m; no limit unless given."
    )
    detection_probability: Probability = Field(
        1, description="Probability that a vehicle within range and field of view gives a measurement, 0 to 1."
    )
    detection: DetectionFactors = Field(
        default_factory=DetectionFactors,
        description="How that probability falls with range and aspect; it does not unless given.",
    )
    by_angle: ByAngle | None = Field(
        None,
        description="How range and noise change with the angle from the boresight; they do not unless given. Trackers "
        "are told the options at the boresight.",
    )
    occlusion: bool = Field(False, description="Whether vehicles hide those behind them.")
    clutter: Clutter = Field(default_factory=Clutter, description="False alarms; none unless given.")
    resolution: Resolution | None = Field(
        None, description="The cell in which two vehicles give one measurement; every vehicle has its own unless given."
    )
    effects: Annotated[list[Annotated[Effect, Plugin(EFFECTS, "type")]], Words()] = Field(
        default_factory=list,
        description="How it differs from an ideal sensor with white noise: nothing (`ideal`), what is `typical` of its "
        "kind, or a list of effects, which act in this order.",
    )
    states: StatedDetection = Field(
        default_factory=StatedDetection,
        description="What it tells trackers where that is not what is simulated, to study wrong figures.",
    )
    dropouts: list[Dropout] = Field(default_factory=list, description="Intervals in which the sensor is silent.")
    latency_s: Latency = Field(
        0.0,
        description="Time from a measurement to its arrival at the tracker, s; [least, most]: drawn evenly for each "
        "scan, the same in every run of a scene. Trackers get scans in the order of arrival.",
    )

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        kind = data.get("type") or cls.kind()
        if data.get("effects") in WORDS:
            is_typical = data["effects"] == "typical"
            data = {**data, "effects": typical(sensor_type(kind), cls.components) if is_typical else []}
        if not isinstance(data.get("preset"), str):
            return {"type": kind, **data}
        of_kind = {name: preset for name, preset in presets().items() if preset.kind == sensor_type(kind)}
        preset = of_kind.get(data["preset"])
        if preset is None:
            nearest = nearest_choices(data["preset"], of_kind)
            problem = f"no {sensor_type(kind)} preset has the name {data['preset']!r}; {nearest}"
            reject(cls.__name__, [Problem(("preset",), problem)])
            return data
        values = {key: value for key, value in preset.values.items() if key not in cls.unused}
        if "by_angle" in values:
            sigma = of_components(values["by_angle"]["sigma"], cls.components)
            values["by_angle"] = {**values["by_angle"], "sigma": sigma}
        return {"type": kind, **values, **data}

    def problems(self) -> Iterator[Problem]:
        stated: KeyPath = ("states", "clutter_per_scan") if self.states.clutter_per_scan else ()
        at: KeyPath = ("clutter", "per_scan") if self.clutter.per_scan else stated
        if at:
            if not self.has_volume():
                yield Problem(at, f"a {self.kind()} has no uniform clutter; remove it")
            elif self.max_range_m is None:
                yield Problem(("max_range_m",), "missing: uniform clutter needs a field of view that ends")
        for name, sigma in zip(self.sigma_options, self.sigmas(), strict=True):
            if not LEAST_SIGMA <= sigma <= LARGEST_SIGMA:
                message = f"{sigma:g} in SI units: it must be from {LEAST_SIGMA:g} to {LARGEST_SIGMA:g}"
                yield Problem((name,), f"{message}; beyond, errors are lost in rounding")
        if self.states.half_range_m is not None and not self.measures_position():
            yield Problem(("states", "half_range_m"), f"a {self.kind()} measures no position; remove it")
        least, most = self.latency
        if least > most:
            yield Problem(("latency_s",), f"the least comes first: [{most:g}, {least:g}]")
        for i, effect in enumerate(self.effects):
            for problem in effect.problems_on(self):
                yield Problem(("effects", i, *problem.at), problem.message)
        for name in self.by_angle.sigma if self.by_angle is not None else ():
            if wrong := self.why_unmeasured(name):
                yield Problem(("by_angle", "sigma", name), wrong)
        if self.resolution is not None and self.resolution.range_rate_mps and "range_rate" not in self.components:
            yield Problem(("resolution", "range_rate_mps"), f"a {self.kind()} measures no range rate; remove it")

    @classmethod
    def why_unmeasured(cls, component: str) -> str:
        """Say that the sensor does not measure a component, and which it measures; empty where it measures it."""
        if component in cls.components:
            return ""
        return f"a {cls.kind()} measures no {component!r}; {nearest_choices(component, cls.components)}"

    @classmethod
    def kind(cls) -> str:
        """The name by which a scenario asks for this class."""
        return SENSOR_MODELS.name_of(cls)

    @property
    def latency(self) -> tuple[float, float]:
        """The least and the most time from a measurement to its arrival, s."""
        low, high = self.latency_s if isinstance(self.latency_s, list) else (self.latency_s, self.latency_s)
        return low, high

    def sigmas(self) -> tuple[float, ...]:
        """``(m,)`` standard deviation of each component of a measurement, in SI units and radians."""
        return tuple(in_si(name, getattr(self, name)) for name in self.sigma_options)

    def biases(self) -> tuple[float, ...]:
        """``(m,)`` constant error of each component of a measurement, in SI units and radians."""
        return (0.0,) * len(self.components)

    def reaches(self, distance: Array, azimuth: Array) -> Mask:
        """Return ``(...)`` whether points at distances, m, and azimuths, rad, are in the field of view."""
        inside = np.abs(azimuth) <= np.deg2rad(self.fov_deg) / 2
        if self.max_range_m is not None:
            inside &= distance <= self.max_range_m
        if self.by_angle is not None:
            inside &= distance <= self.by_angle.range_limit(azimuth)
        return np.asarray(inside)

    def uniform(self, shares: Array) -> Array:
        """Measurements ``(m, n)`` uniform in the field of view, from numbers ``(m, n)`` uniform in 0 to 1.

        What clutter is uniform in; a sensor without it has no uniform clutter.
        """
        raise NotImplementedError

    @classmethod
    def has_volume(cls) -> bool:
        """Whether it says in what its clutter is uniform."""
        return cls.uniform is not Sensor.uniform

    def volume(self) -> float:
        """Volume of the field of view in the space of measurements, in SI units and radians."""
        raise NotImplementedError

    def noise_covariance(self) -> Array:
        """``(m, m)`` covariance that the sensor states of its measurements."""
        return np.diag(np.array(self.sigmas()) ** 2)

    @classmethod
    def other_noise(cls, covariance: Array, sigmas: Mapping[str, float]) -> Array:
        """``(m, m)`` the covariance with other standard deviations, by their option, and the same correlations.

        ``(m, m, ...)`` where a standard deviation is ``(...)``.
        """
        own = np.sqrt(np.diag(covariance))
        other = [in_si(name, sigmas[name]) if name in sigmas else own[i] for i, name in enumerate(cls.sigma_options)]
        ratio = linalg.vector([sigma / own[i] for i, sigma in enumerate(other)])
        return np.asarray(linalg.expand(covariance, ratio[None]) * (ratio[:, None] * ratio[None]))

    @classmethod
    @abstractmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        """``(m, ...)`` what an ideal sensor reads of a target ``(4, ...)``."""

    @classmethod
    @abstractmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        """``(m, 4, ...)`` derivative of ``measure`` with respect to the target's state."""

    @classmethod
    @abstractmethod
    def position(cls, scan: Scan) -> Gaussian:
        """The position ``(2, ...)`` in the fixed frame that a measurement states, with its covariance.

        NaN where the sensor measures no position.
        """

    @classmethod
    def measures_position(cls) -> bool:
        """Whether one measurement states a position, so that a track can start from it."""
        return True

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        """The velocity ``(2, ...)`` in the fixed frame of a target that moves along the line of sight.

        A first guess from one measurement; zero where the measurement says nothing of the velocity.
        """
        return np.zeros((2, *scan.measurement.shape[1:]))

    @classmethod
    def measures_velocity(cls) -> bool:
        """Whether one measurement says something of the velocity."""
        return cls.radial_velocity.__func__ is not Sensor.radial_velocity.__func__  # type: ignore[attr-defined]


def _lacks(sensor: Any) -> str | None:
    lacking = lacks_class(Sensor)(sensor)
    if lacking is not None:
        return lacking
    size = len(sensor.components)
    for name in ("units", "sigma_options"):
        if len(getattr(sensor, name)) != size:
            return f"it has {size} components and {len(getattr(sensor, name))} {name}"
    for name in sensor.sigma_options:
        if name not in sensor.model_fields or split_key(name)[1] is None:
            return f"its sigma_options name {name!r}, which is no option with a unit at its end"
    return None


#: The sensors by the names that scenarios use; ``SENSOR_MODELS[scan.kind]`` has the equations of a scan.
SENSOR_MODELS: Registry[type[Sensor]] = Registry("trackbench.sensors", "sensor", _lacks)

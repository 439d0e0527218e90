"""Base class of sensors: their options in a scenario, and the equations of their measurements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.config import (
    Angle,
    Config,
    NonNegative,
    Positive,
    Probability,
)
from trackbench.base.config.key_units import in_si
from trackbench.base.errors import nearest_choices
from trackbench.base.types import Array, Gaussian, Mask, Scan
from trackbench.models.sensors.detection import Clutter, DetectionFactors, Resolution


class Mount(Config):
    """Pose of the sensor on the observer."""

    x_m: float = Field(0, ge=-100, le=100, description="Forward of the observer's centre, m.")
    y_m: float = Field(0, ge=-100, le=100, description="Left of the observer's centre, m.")
    yaw_deg: Angle = Field(0, description="Direction of the boresight, counter-clockwise from straight ahead, degrees.")


class SensorModel(Config, ABC):
    """Sensor with a known pose and velocity that measures a target with the state px, py, vx, vy (fixed frame).

    The fields of a subclass are its options in a scenario, and its class methods the equations, which need no options.
    ``pose`` is ``(3, ...)`` x, y, yaw and ``velocity`` ``(2, ...)`` vx, vy of the sensor.
    """

    components: ClassVar[tuple[str, ...]]
    """Names of the measurement's components, such as "range"."""
    angular: ClassVar[tuple[int, ...]] = ()
    """Indices of the measurement's components that are angles."""
    units: ClassVar[tuple[str, ...]]
    """Unit of each component of the measurement: "m", "rad" or "m/s"."""
    sigma_options: ClassVar[tuple[str, ...]]
    """Name of the option, with a unit at its end, that states each component's standard deviation:
    "azimuth_sigma_deg"."""
    pure: ClassVar[bool] = False
    """Whether the results of the class methods depend on their arguments alone, so that the fused engine may compile
    them. A subclass must state this anew."""
    unused: ClassVar[tuple[str, ...]] = ()
    """Options that this class does not use, and that a preset of values is nevertheless allowed to set."""

    type: str = Field("", description="Type of the sensor.")
    preset: str | None = Field(
        None,
        description="A real sensor whose published figures are the defaults of the other keys, of required ones too "
        "(`trackbench list sensors` shows them).",
    )
    rate_hz: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="Scans per second, Hz; it divides truth.rate_hz. Required unless the measurements are recorded.",
    )
    phase_s: NonNegative = Field(
        0, description="Time of the first measurement, s; a whole number of truth steps, shorter than a period."
    )
    mount: Mount = Field(default_factory=Mount, description="Pose on the observer.")
    fov_deg: float = Field(
        360, gt=0, le=360, description="Full horizontal field of view, centred on the boresight, degrees."
    )
    max_range_m: Positive | None = Field(
        None, description="Range beyond which nothing is detected, m; default: no limit."
    )
    detection_probability: Probability = Field(
        1, description="Probability that a vehicle within range and field of view gives a measurement, 0 to 1."
    )
    detection: DetectionFactors = Field(
        default_factory=DetectionFactors,
        description="Fall of the detection probability with the range; default: none.",
    )
    occlusion: bool = Field(False, description="Whether vehicles hide the vehicles behind them.")
    clutter: Clutter = Field(default_factory=Clutter, description="False alarms; default: none.")
    resolution: Resolution | None = Field(
        None, description="Cell in which two vehicles give one measurement; default: every vehicle gives its own."
    )

    @classmethod
    @abstractmethod
    def kind(cls) -> str:
        """Return the name by which a scenario names this class of sensors."""

    @classmethod
    def why_unmeasured(cls, component: str) -> str:
        """Return a sentence, with the nearest choice, if the sensor does not measure a component; else empty text."""
        if component in cls.components:
            return ""
        return f"a {cls.kind()} measures no {component!r}; {nearest_choices(component, cls.components)}"

    def sigmas(self) -> tuple[float, ...]:
        """Return the standard deviations ``(m,)`` of the noise on each component, in SI units and radians."""
        return tuple(in_si(name, getattr(self, name)) for name in self.sigma_options)

    def reaches(self, distance: Array, azimuth: Array) -> Mask:
        """Return a mask ``(...)`` of the points in the field of view, from their distances, m, and azimuths, rad."""
        inside = np.abs(azimuth) <= np.deg2rad(self.fov_deg) / 2
        if self.max_range_m is not None:
            inside &= distance <= self.max_range_m
        return np.asarray(inside)

    def uniform(self, shares: Array) -> Array:
        """Return measurements ``(m, n)`` uniform in the field of view, from ``shares`` ``(m, n)`` uniform from 0 to 1.

        A sensor class without this method has no uniform clutter.
        """
        raise NotImplementedError

    @classmethod
    def has_volume(cls) -> bool:
        """Return whether the class defines ``uniform``, and so can have false alarms uniform in the field of view."""
        return cls.uniform is not SensorModel.uniform

    def volume(self) -> float:
        """Return the volume of the field of view in the space of measurements, in SI units and radians."""
        raise NotImplementedError

    def noise_covariance(self) -> Array:
        """Return the covariance ``(m, m)`` of the measurement noise that the sensor states."""
        return np.diag(np.array(self.sigmas()) ** 2)

    @classmethod
    def other_noise(cls, covariance: Array, sigmas: Mapping[str, float]) -> Array:
        """Return the covariance ``(m, m)`` with standard deviations replaced by ``sigmas``, at unchanged correlations.

        The keys of ``sigmas`` are options. The result is ``(m, m, ...)`` where a standard deviation is ``(...)``.
        """
        current = np.sqrt(np.diag(covariance))
        new = [in_si(name, sigmas[name]) if name in sigmas else current[i] for i, name in enumerate(cls.sigma_options)]
        ratio = linalg.vector([sigma / current[i] for i, sigma in enumerate(new)])
        return np.asarray(linalg.expand(covariance, ratio[None]) * (ratio[:, None] * ratio[None]))

    @classmethod
    @abstractmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        """Return the error-free measurement ``(m, ...)`` of a target ``(4, ...)``."""

    @classmethod
    @abstractmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        """Return the derivative ``(m, 4, ...)`` of ``measure`` with respect to the target's state."""

    @classmethod
    @abstractmethod
    def position(cls, scan: Scan) -> Gaussian:
        """Return the position ``(2, ...)`` in the fixed frame that a measurement states, with its covariance.

        The position is NaN for a sensor that measures none.
        """

    @classmethod
    def measures_position(cls) -> bool:
        """Return whether a single measurement states a position, so that a track can start from it."""
        return True

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        """Return the velocity ``(2, ...)`` in the fixed frame of a target that moves along the line of sight.

        This is a first guess from one measurement; zero for a sensor without information on the velocity.
        """
        return np.zeros((2, *scan.measurement.shape[1:]))

    @classmethod
    def measures_velocity(cls) -> bool:
        """Return whether a single measurement tells something of the target's velocity."""
        return cls.radial_velocity.__func__ is not SensorModel.radial_velocity.__func__  # type: ignore[attr-defined]

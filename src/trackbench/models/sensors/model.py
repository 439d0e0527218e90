"""Options and equations of a sensor."""

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
    """The sensor's pose on the observer."""

    x_m: float = Field(0, ge=-100, le=100, description="Forward of the observer's centre, m.")
    y_m: float = Field(0, ge=-100, le=100, description="Left of the observer's centre, m.")
    yaw_deg: Angle = Field(0, description="Direction of the boresight, counter-clockwise from straight ahead, degrees.")


class SensorModel(Config, ABC):
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
        description="How that probability falls with the range; it does not unless given.",
    )
    occlusion: bool = Field(False, description="Whether vehicles hide those behind them.")
    clutter: Clutter = Field(default_factory=Clutter, description="False alarms; none unless given.")
    resolution: Resolution | None = Field(
        None, description="The cell in which two vehicles give one measurement; every vehicle has its own unless given."
    )

    @classmethod
    @abstractmethod
    def kind(cls) -> str:
        """The name by which a scenario asks for this class."""

    @classmethod
    def why_unmeasured(cls, component: str) -> str:
        """Say that the sensor does not measure a component, and which it measures; empty where it measures it."""
        if component in cls.components:
            return ""
        return f"a {cls.kind()} measures no {component!r}; {nearest_choices(component, cls.components)}"

    def sigmas(self) -> tuple[float, ...]:
        """``(m,)`` standard deviation of each component of a measurement, in SI units and radians."""
        return tuple(in_si(name, getattr(self, name)) for name in self.sigma_options)

    def reaches(self, distance: Array, azimuth: Array) -> Mask:
        """Return ``(...)`` whether points at distances, m, and azimuths, rad, are in the field of view."""
        inside = np.abs(azimuth) <= np.deg2rad(self.fov_deg) / 2
        if self.max_range_m is not None:
            inside &= distance <= self.max_range_m
        return np.asarray(inside)

    def uniform(self, shares: Array) -> Array:
        """Measurements ``(m, n)`` uniform in the field of view, from numbers ``(m, n)`` uniform in 0 to 1.

        What clutter is uniform in; a sensor without it has no uniform clutter.
        """
        raise NotImplementedError

    @classmethod
    def has_volume(cls) -> bool:
        """Whether it says in what its clutter is uniform."""
        return cls.uniform is not SensorModel.uniform

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
        return cls.radial_velocity.__func__ is not SensorModel.radial_velocity.__func__  # type: ignore[attr-defined]

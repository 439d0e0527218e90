"""Radar, which measures range, azimuth and range rate, or some of these."""

from __future__ import annotations

import builtins
import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any, ClassVar, Literal, Self, TypeVar, cast

import numpy as np
from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, create_model, model_validator

from trackbench.base import linalg
from trackbench.base.config import KeyPath, Problem
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.base.units import cos_sin, exp_minus_one
from trackbench.models.sensors.base import SENSOR_MODELS, Sensor

T = TypeVar("T")

#: Smallest range with a defined direction to a target, m; keeps Jacobians finite at the sensor.
MIN_RANGE = 1e-6


class Polar(Sensor):
    """Base of all radars, which measure range m, azimuth rad from the boresight, and a third component, m/s."""

    range_sigma_m: float = Field(ge=1e-6, le=1e4, description="Standard deviation of the range, m.")
    azimuth_sigma_deg: float = Field(ge=1e-7, le=90, description="Standard deviation of the azimuth, degrees.")

    angular: ClassVar[tuple[int, ...]] = (1,)
    units: ClassVar[tuple[str, ...]] = ("m", "rad", "m/s")

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        """Convert range and azimuth to a position x, y without bias.

        Source: Mo, Song, Zhou, Sun and Bar-Shalom (1998), "Unbiased converted measurements for tracking". The
        covariance is conditioned on the measurement and computed along and across the line of sight; along x and y,
        large squares of the range would cancel.
        """
        r, azimuth = scan.measurement[0], scan.measurement[1]
        var_r, var_a = scan.noise_covariance[0, 0], scan.noise_covariance[1, 1]
        shrink = np.exp(-var_a / 2)
        angle = azimuth + scan.sensor_pose[2]
        c, s = cos_sin(angle)
        mean = linalg.vector([scan.sensor_pose[0] + r * c / shrink, scan.sensor_pose[1] + r * s / shrink])
        loss = -0.5 * exp_minus_one(-2.0 * var_a)
        along = r * r * (exp_minus_one(var_a) - loss) + var_r * (1.0 - loss)
        across = (r * r + var_r) * loss
        xx, yy = along * c * c + across * s * s, along * s * s + across * c * c
        xy = (along - across) * c * s
        return Gaussian(mean, linalg.rounded_up(linalg.matrix([[xx, xy], [xy, yy]])))


class Radar(Polar):
    """Radar that measures range, azimuth and range rate (relative to the moving sensor), or some of these."""

    measures: list[Literal["range", "azimuth", "range_rate"]] = Field(
        ["range", "azimuth", "range_rate"],
        min_length=1,
        description="Measured components: some of range, azimuth and range_rate, such as [range, azimuth]. Leave out "
        "the standard deviations of the others.",
    )
    range_rate_sigma_mps: float = Field(ge=1e-6, le=1e4, description="Standard deviation of the range rate, m/s.")

    # Each choice of one or two components has a subclass, in PARTIAL_RADARS.
    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "range_rate")
    sigma_options: ClassVar[tuple[str, ...]] = ("range_sigma_m", "azimuth_sigma_deg", "range_rate_sigma_mps")

    def __new__(cls, **options: Any) -> Radar:
        return super().__new__(cls._measuring(options))

    @model_validator(mode="wrap")
    @classmethod
    def _as_partial_radar(cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        model = cls._measuring(data)
        if model is cls:
            return handler(data)
        return cast(Self, model.model_validate({**data, "type": model.kind()}, context=info.context))

    @classmethod
    def _measuring(cls, options: Any) -> builtins.type[Radar]:
        named = options.get("measures") if isinstance(options, dict) and cls is Radar else None
        components = tuple(name for name in Radar.components if isinstance(named, list) and name in named)
        return PARTIAL_RADARS.get(components, cls)

    def problems(self) -> Iterator[Problem]:
        for i, name in enumerate(self.measures):
            if name in self.measures[:i]:
                yield Problem(("measures", i), f"{name} is named twice; remove one")
        stated: list[KeyPath] = [(key,) for key in self.unused if getattr(self, key) is not None]
        if "range_rate" not in self.components and "range_rate_mps" in self.clutter.model_fields_set:
            stated.append(("clutter", "range_rate_mps"))
        named = f"measures is [{', '.join(self.components)}], which does not have it"
        yield from (Problem(at, f"{named}; remove this, or add its component to measures") for at in stated)
        yield from super().problems()

    def uniform(self, shares: Array) -> Array:
        """Return measurements uniformly distributed in each component within its limits."""
        (low, high), fov = self.clutter.range_rate_mps, np.deg2rad(self.fov_deg)
        assert self.max_range_m is not None
        share = dict(zip(self.components, shares, strict=True))
        r, azimuth, rate = (share.get(name, 0.0) for name in Radar.components)
        return np.stack(self._select_measured(r * self.max_range_m, (azimuth - 0.5) * fov, low + rate * (high - low)))

    def volume(self) -> float:
        """Return the volume of the field of view, in the product of the components' units (m rad m/s)."""
        low, high = self.clutter.range_rate_mps
        assert self.max_range_m is not None
        return float(math.prod(self._select_measured(self.max_range_m, np.deg2rad(self.fov_deg), high - low)))

    @classmethod
    def _select_measured(cls, range_: T, azimuth: T, range_rate: T) -> tuple[T, ...]:
        values = {"range": range_, "azimuth": azimuth, "range_rate": range_rate}
        return tuple(values[name] for name in cls.components)

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        r = np.maximum(np.sqrt(dx * dx + dy * dy), MIN_RANGE)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        azimuth = np.arctan2(c * dy - s * dx, c * dx + s * dy)
        rate = (dx * (target[2] - velocity[0]) + dy * (target[3] - velocity[1])) / r
        return linalg.vector(cls._select_measured(r, azimuth, rate))

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        inverse = 1.0 / np.maximum(np.sqrt(dx * dx + dy * dy), MIN_RANGE)
        ux, uy = dx * inverse, dy * inverse
        # Velocity across the line of sight, over the range: the rate at which the line of sight turns.
        turn = (ux * (target[3] - velocity[1]) - uy * (target[2] - velocity[0])) * inverse
        return linalg.matrix(
            cls._select_measured([ux, uy, 0, 0], [-uy * inverse, ux * inverse, 0, 0], [-uy * turn, ux * turn, ux, uy])
        )

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        if cls.measures_position():
            return super().position(scan)
        nowhere = np.full((2, 2, *scan.measurement.shape[1:]), np.nan)
        return Gaussian(nowhere[0], nowhere)

    @classmethod
    def measures_position(cls) -> bool:
        return {"range", "azimuth"} <= set(cls.components)

    @classmethod
    def radial_velocity(cls, scan: Scan) -> Array:
        if not cls.measures_velocity():
            return super().radial_velocity(scan)
        along = along_sight(scan)
        return linalg.vector([along[0] + scan.sensor_velocity[0], along[1] + scan.sensor_velocity[1]])

    @classmethod
    def measures_velocity(cls) -> bool:
        return len(cls.components) == len(Radar.components)


def along_sight(scan: Scan) -> Array:
    """Return a measurement's third component, a speed, as a vector ``(2, ...)`` in the fixed frame."""
    c, s = cos_sin(scan.measurement[1] + scan.sensor_pose[2])
    return linalg.vector([scan.measurement[2] * c, scan.measurement[2] * s])


def _partial_radar(components: tuple[str, ...]) -> type[Radar]:
    name = "".join(part.title().replace("_", "") for part in components) + "Radar"
    rows = [Radar.components.index(part) for part in components]
    unused = tuple(key for i, key in enumerate(Radar.sigma_options) if i not in rows)
    fields: dict[str, Any] = dict.fromkeys(unused, (float | None, None))
    model = create_model(name, __base__=Radar, __module__=__name__, **fields)
    model.components, model.unused, model.angular = components, unused, tuple(rows.index(i) for i in {1} & {*rows})
    model.sigma_options, model.units = (tuple(of[i] for i in rows) for of in (Radar.sigma_options, Radar.units))
    SENSOR_MODELS.plugins[f"radar({', '.join(components)})"] = globals()[name] = model
    return model


#: Radar classes that measure one or two components, by these components.
PARTIAL_RADARS = {
    components: _partial_radar(components) for size in (1, 2) for components in combinations(Radar.components, size)
}

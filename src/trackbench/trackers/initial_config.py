"""How a track of a built-in filter starts, as a scenario says it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field, model_validator

from trackbench.base.config import Config, Positive, Problem

InitialSource = Literal["first_measurement", "two_measurements", "truth"]

#: Where each key of the initial state is used; elsewhere the measurements give it.
INITIAL_SOURCES: dict[str, tuple[str, ...]] = {
    "sensors": ("first_measurement", "two_measurements"),
    "skip": ("first_measurement", "two_measurements"),
    "waiting": ("first_measurement", "two_measurements"),
    "velocity": ("first_measurement",),
    "least_time_s": ("two_measurements",),
    "position_sigma_m": ("truth",),
    "velocity_sigma_mps": ("first_measurement", "truth"),
}


class InitialConfig(Config):
    """How a track starts, and how uncertain its first state is said to be."""

    source: InitialSource = Field(
        "first_measurement",
        alias="from",
        description="first_measurement: position of the first measurement, and what it tells of the velocity. "
        "two_measurements: velocity from the displacement between two. truth: drawn from the truth with the standard "
        "deviations below, for consistency tests.",
    )
    sensors: list[str] | None = Field(
        None,
        min_length=1,
        description="Names of the sensors whose measurements start a track; those that the tracker reads unless given. "
        "Not from truth.",
    )
    skip: int = Field(
        0,
        ge=0,
        le=1000,
        description="How many measurements of an object are passed over before those that start its track.",
    )
    waiting: Literal["nothing", "at_rest"] = Field(
        "nothing",
        description="What is said of an object before its track starts, and scored. at_rest: it stands where its "
        "latest measurement says, its velocity being as unknown as from first_measurement.",
    )
    least_time_s: float = Field(
        0.2, ge=0, le=60, description="Least time between the two measurements, s; from two_measurements only."
    )
    velocity: Literal["zero", "radial", "range_rate"] = Field(
        "range_rate",
        description="First velocity, from first_measurement only. zero: zero. radial: the third component of a radar's "
        "measurement, along the line of sight. range_rate: the same, and along the line of sight as certain as the "
        "range rate is; velocity_sigma_mps holds across it, and all around where the sensor has no range rate or the "
        "state no vx, vy.",
    )
    position_sigma_m: Positive = Field(
        1, description="Standard deviation of each position component, m; from truth only."
    )
    velocity_sigma_mps: Positive = Field(
        20,
        description="Standard deviation of each velocity component, m/s; not from two_measurements.",
    )
    acceleration_sigma_mps2: Positive = Field(
        3, description="Standard deviation of the acceleration, m/s^2, where the state has it."
    )
    yaw_sigma_rad: Positive | None = Field(
        None,
        description="Standard deviation of the course, rad, where the state has it. From truth: 0.1 unless given. "
        "From measurements: the most that is said of it, pi / sqrt(3) (nothing known) unless given.",
    )
    yaw_rate_sigma_radps: Positive = Field(
        0.3, description="Standard deviation of the yaw rate, rad/s, where the state has it."
    )

    @model_validator(mode="before")
    @classmethod
    def _word(cls, data: Any) -> Any:
        return {"from": data} if isinstance(data, str) else data

    covariance_diag: list[Positive] | None = Field(
        None,
        description="Diagonal of the covariance that the first state is said to have, one variance for each component "
        "of the state. Unless given, it is what the measurement and the standard deviations above give.",
    )

    def problems(self) -> Iterator[Problem]:
        for key in (name for name in type(self).model_fields if name in self.model_fields_set):
            sources = INITIAL_SOURCES.get(key, (self.source,))
            if self.source not in sources:
                allowed = " or ".join(sources)
                yield Problem((key,), f"not used with from: {self.source}; remove it, or use from: {allowed}")
            elif "sigma" in key and self.covariance_diag is not None and self.source != "truth":
                yield Problem((key,), "not used with covariance_diag, which says it all; remove one of them")

"""Trackers as a scenario names them: a built-in filter with a motion model, or a class of the user's own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from trackbench.config import PROBLEM, Config, Positive, Problem

FilterName = Literal["kf", "ekf", "iekf", "ukf", "ckf"]
MotionName = Literal["cv", "ca", "ctrv", "ctra"]
InitialSource = Literal["first_reading", "two_readings", "truth"]

#: The process noise that each motion model is driven by.
MOTION_NOISE: dict[str, tuple[str, ...]] = {
    "cv": ("acceleration_sigma_mps2",),
    "ca": ("jerk_sigma_mps3",),
    "ctrv": ("acceleration_sigma_mps2", "yaw_acceleration_sigma_radps2"),
    "ctra": ("jerk_sigma_mps3", "yaw_acceleration_sigma_radps2"),
}
NOISE_KEYS = tuple(dict.fromkeys(key for keys in MOTION_NOISE.values() for key in keys))

#: Keys that only one filter has.
FILTER_KEYS: dict[str, tuple[str, ...]] = {
    "ukf": ("sigma_points", "augmented", "alpha", "beta", "kappa"),
    "iekf": ("iterations",),
}
LINEAR_MOTION = ("cv", "ca")

#: Where each standard deviation of the initial state is used; elsewhere the readings give it.
INITIAL_SOURCES: dict[str, tuple[str, ...]] = {
    "position_sigma_m": ("truth",),
    "velocity_sigma_mps": ("first_reading", "truth"),
}
INITIAL_MOTIONS: dict[str, tuple[str, ...]] = {
    "acceleration_sigma_mps2": ("ca", "ctra"),
    "yaw_sigma_rad": ("ctrv", "ctra"),
    "yaw_rate_sigma_radps": ("ctrv", "ctra"),
}


class InitialConfig(Config):
    """How a track starts, and how uncertain its first state is said to be."""

    source: InitialSource = Field(
        "two_readings",
        alias="from",
        description="first_reading: position of the first reading, velocity unknown. two_readings: velocity "
        "from the displacement between the first two. truth: drawn from the truth with the standard "
        "deviations below, for consistency tests.",
    )
    position_sigma_m: Positive = Field(
        1, description="Standard deviation of each position component, m; from truth only."
    )
    velocity_sigma_mps: Positive = Field(
        20, description="Standard deviation of each velocity component, m/s; from first_reading and truth."
    )
    acceleration_sigma_mps2: Positive = Field(
        3, description="Standard deviation of the acceleration, m/s^2; motion ca and ctra."
    )
    yaw_sigma_rad: Positive | None = Field(
        None,
        description="Standard deviation of the course, rad; motion ctrv and ctra. From truth: 0.1 unless given. "
        "From readings: the most that is said of it, pi / sqrt(3) (nothing known) unless given.",
    )
    yaw_rate_sigma_radps: Positive = Field(
        0.3, description="Standard deviation of the yaw rate, rad/s; motion ctrv and ctra."
    )

    @model_validator(mode="before")
    @classmethod
    def _word(cls, data: Any) -> Any:
        return {"from": data} if isinstance(data, str) else data

    def problems(self) -> Iterator[Problem]:
        for key, sources in INITIAL_SOURCES.items():
            if key in self.model_fields_set and self.source not in sources:
                allowed = " or ".join(sources)
                yield Problem((key,), f"not used with from: {self.source}; remove it, or use from: {allowed}")


class FilterConfig(Config):
    """A built-in filter with a motion model."""

    filter: FilterName = Field(description="The filter (`trackbench list filters` shows them).")
    motion: MotionName = Field(description="The motion model (`trackbench list motion-models` shows them).")
    sensors: list[str] | None = Field(
        None, min_length=1, description="Names of the sensors it reads; all unless given."
    )
    acceleration_sigma_mps2: Positive | None = Field(
        None,
        description="Standard deviation of the acceleration that drives cv and ctrv, m/s^2; required there.",
    )
    jerk_sigma_mps3: Positive | None = Field(
        None, description="Standard deviation of the jerk that drives ca and ctra, m/s^3; required there."
    )
    yaw_acceleration_sigma_radps2: Positive | None = Field(
        None,
        description="Standard deviation of the yaw acceleration that drives ctrv and ctra, rad/s^2; required there.",
    )
    initial: InitialConfig = Field(
        default_factory=InitialConfig,
        description="How a track starts; a single word is short for {from: word}.",
    )
    sigma_points: Literal["scaled", "classic"] = Field(
        "scaled",
        description="ukf only. scaled: weights from alpha, beta and kappa (van der Merwe). classic: from "
        "kappa alone (Julier).",
    )
    augmented: bool = Field(True, description="ukf only. Whether the sigma points also spread over the process noise.")
    alpha: float = Field(1, gt=0, le=1, description="ukf with scaled sigma points only. Their spread, 0 to 1.")
    beta: float = Field(
        2, ge=0, description="ukf with scaled sigma points only. 2 is best for a Gaussian distribution."
    )
    kappa: float | None = Field(
        None,
        description="ukf only. Secondary spread of the sigma points. Unless given: 0 with scaled, and 3 "
        "minus the number of spread components with classic.",
    )
    iterations: int = Field(5, ge=1, le=100, description="iekf only. How often an update is linearised again.")

    def problems(self) -> Iterator[Problem]:
        given = self.model_fields_set
        if self.filter == "kf" and self.motion not in LINEAR_MOTION:
            yield Problem(
                ("motion",),
                f"kf needs a linear motion model: use cv or ca, or filter: ekf with {self.motion}",
            )
        used = MOTION_NOISE[self.motion]
        for key in NOISE_KEYS:
            if key in used and getattr(self, key) is None:
                yield Problem((key,), f"missing: motion {self.motion} needs {' and '.join(used)}")
            if key not in used and key in given:
                yield Problem((key,), f"motion {self.motion} does not use this; it uses {' and '.join(used)}")
        for name, keys in FILTER_KEYS.items():
            for key in keys:
                if key in given and self.filter != name:
                    yield Problem((key,), f"only filter {name} has this key; the filter here is {self.filter}")
        for key in ("alpha", "beta"):
            if key in given and self.filter == "ukf" and self.sigma_points == "classic":
                yield Problem((key,), "not used with sigma_points: classic; remove it, or use sigma_points: scaled")
        for key, motions in INITIAL_MOTIONS.items():
            if key in self.initial.model_fields_set and self.motion not in motions:
                uses = " and ".join(motions)
                yield Problem(("initial", key), f"motion {self.motion} has no such component; {uses} have")
        yield from _repeated(self.sensors)


class PluginConfig(Config):
    """A tracker of the user's own, or one published under the entry-point group trackbench.trackers."""

    use: str = Field(min_length=1, description='A published name, such as raw, or "package.module:Class".')
    options: dict[str, Any] = Field(
        default_factory=dict, description="Keyword arguments of the class, passed on as they are."
    )
    sensors: list[str] | None = Field(
        None, min_length=1, description="Names of the sensors it reads; all unless given."
    )

    def problems(self) -> Iterator[Problem]:
        yield from _repeated(self.sensors)


def _repeated(sensors: list[str] | None) -> Iterator[Problem]:
    for index, name in enumerate(sensors or []):
        if name in (sensors or [])[:index]:
            yield Problem(("sensors", index), f"{name!r} is named twice; remove one")


def _kind(value: Any) -> str | None:
    if isinstance(value, FilterConfig | PluginConfig):
        return "<filter>" if isinstance(value, FilterConfig) else "<use>"
    kinds = [key for key in ("filter", "use") if isinstance(value, dict) and key in value]
    return f"<{kinds[0]}>" if len(kinds) == 1 else None


AnyTracker = Annotated[
    Annotated[FilterConfig, Tag("<filter>")] | Annotated[PluginConfig, Tag("<use>")],
    Discriminator(
        _kind,
        custom_error_type=PROBLEM,
        custom_error_message="write filter (built in: kf, ekf, iekf, ukf, ckf) or use (your own), and not both",
    ),
]

"""Sensors of a scenario: a model with effects, latency and times without measurements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field, Tag, model_validator

from trackbench.base.config import (
    LARGEST_SIGMA,
    LEAST_SIGMA,
    LIST,
    NUMBER,
    Config,
    KeyPath,
    NonNegative,
    Problem,
    chosen_by,
    number_or_list,
    reject,
)
from trackbench.base.config.key_units import split_key
from trackbench.base.config.plugin import Plugin
from trackbench.base.errors import nearest_choices
from trackbench.base.plugins import Registry, lacks_class
from trackbench.models.sensors.detection import StatedDetection
from trackbench.models.sensors.effects import EFFECTS, Effect
from trackbench.models.sensors.model import SensorModel
from trackbench.models.sensors.presets import WORDS, Words, presets, typical

#: Time from a measurement to its arrival, s.
Delay = Annotated[float, Field(ge=0, le=60)]


Latency = Annotated[
    Annotated[Delay, Tag(NUMBER)] | Annotated[list[Delay], Field(min_length=2, max_length=2), Tag(LIST)],
    chosen_by(number_or_list, "write a time, such as 0.1, or the least and the most, such as [0.05, 0.2]"),
]


def sensor_type(kind: str) -> str:
    """Return the type of sensor in the kind of a scan: "radar" for "radar(range, azimuth)"."""
    return kind.partition("(")[0]


class Dropout(Config):
    """Interval of time in which the sensor makes no measurements."""

    from_s: NonNegative = Field(description="First instant without a measurement, s.")
    to_s: NonNegative = Field(description="First instant with measurements again, s.")

    def problems(self) -> Iterator[Problem]:
        if self.from_s >= self.to_s:
            yield Problem(("to_s",), f"must be later than from_s, which is {self.from_s:g}")


class Sensor(SensorModel):
    """Sensor model with effects, latency and dropouts; base class of a user's sensor."""

    effects: Annotated[list[Annotated[Effect, Plugin(EFFECTS, "type")]], Words()] = Field(
        default_factory=list,
        description="Differences from an ideal sensor with white noise: none (`ideal`), the `typical` effects of its "
        "type, or a list of effects, which act in this order.",
    )
    states: StatedDetection = Field(
        default_factory=StatedDetection,
        description="Figures that trackers are told in place of the simulated ones, to see what wrong figures cost.",
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
        presets_of_type = {name: preset for name, preset in presets().items() if preset.kind == sensor_type(kind)}
        preset = presets_of_type.get(data["preset"])
        if preset is None:
            nearest = nearest_choices(data["preset"], presets_of_type)
            problem = f"no {sensor_type(kind)} preset has the name {data['preset']!r}; {nearest}"
            reject(cls.__name__, [Problem(("preset",), problem)])
            return data
        values = {key: value for key, value in preset.values.items() if key not in cls.unused}
        return {"type": kind, **values, **data}

    def problems(self) -> Iterator[Problem]:
        stated: KeyPath = ("states", "clutter_per_scan") if self.states.clutter_per_scan else ()
        at: KeyPath = ("clutter", "per_scan") if self.clutter.per_scan else stated
        if at:
            if not self.has_volume():
                yield Problem(at, f"a {self.kind()} has no uniform clutter; remove it")
            elif self.max_range_m is None:
                yield Problem(("max_range_m",), "missing: uniform clutter needs a limited range")
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
        if self.resolution is not None and self.resolution.range_rate_mps and "range_rate" not in self.components:
            yield Problem(("resolution", "range_rate_mps"), f"a {self.kind()} measures no range rate; remove it")

    @classmethod
    def kind(cls) -> str:
        """Return the name by which a scenario names this class of sensors."""
        return SENSOR_MODELS.name_of(cls)

    @property
    def latency(self) -> tuple[float, float]:
        """Shortest and longest time from a measurement to its arrival, s."""
        low, high = self.latency_s if isinstance(self.latency_s, list) else (self.latency_s, self.latency_s)
        return low, high


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


#: Sensors by the names that scenarios use; ``SENSOR_MODELS[scan.kind]`` has the equations of a scan.
SENSOR_MODELS: Registry[type[Sensor]] = Registry("trackbench.sensors", "sensor", _lacks)

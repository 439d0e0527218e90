"""Sensors: where they sit, when they look, what they see and how wrong they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from trackbench.config import Angle, Config, NonNegative, Positive, Probability, Problem, reject
from trackbench.errors import nearest
from trackbench.sensing.presets import presets


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


class SensorConfig(Config):
    """What all sensors have in common."""

    type: str = Field(description="The kind of sensor.")
    preset: str | None = Field(
        None,
        description="A real sensor whose published figures are the defaults of the other keys "
        "(`trackbench list sensors` shows them).",
    )
    rate_hz: float = Field(gt=0, le=1000, description="Measurements per second, Hz; it divides truth.rate_hz.")
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
    dropouts: list[Dropout] = Field(default_factory=list, description="Intervals in which the sensor is silent.")
    latency_s: float = Field(0, ge=0, le=60, description="Delay from the measurement to its arrival at the tracker, s.")

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_preset(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("preset"), str):
            return data
        kind = cls.model_fields["type"].default
        known = {name: preset for name, preset in presets().items() if preset.kind == kind}
        preset = known.get(data["preset"])
        if preset is None:
            problem = f"no {kind} preset has the name {data['preset']!r}; {nearest(data['preset'], known)}"
            reject(cls.__name__, [Problem(("preset",), problem)])
            return data
        return {**preset.values, **data}


class PolarConfig(SensorConfig):
    """What the kinds of radar have in common."""

    range_sigma_m: float = Field(gt=0, le=1000, description="Standard deviation of the range, m.")
    azimuth_sigma_deg: float = Field(gt=0, le=90, description="Standard deviation of the azimuth, degrees.")
    range_bias_m: float = Field(0, description="Constant error of the range, m.")
    azimuth_bias_deg: Angle = Field(0, description="Constant error of the azimuth, degrees.")


class RadarConfig(PolarConfig):
    """Measures range, azimuth and range rate."""

    type: Literal["radar"] = Field("radar", description="The kind of sensor.")
    range_rate_sigma_mps: float = Field(gt=0, le=1000, description="Standard deviation of the range rate, m/s.")
    range_rate_bias_mps: float = Field(0, description="Constant error of the range rate, m/s.")


class SpeedRadarConfig(PolarConfig):
    """Measures range, azimuth and, in place of the range rate, the target's speed over ground.

    No radar does; it is for trackers that were written for such measurements.
    """

    type: Literal["speed_radar"] = Field("speed_radar", description="The kind of sensor.")
    speed_sigma_mps: float = Field(gt=0, le=1000, description="Standard deviation of the speed, m/s.")
    speed_bias_mps: float = Field(0, description="Constant error of the speed, m/s.")


class LidarConfig(SensorConfig):
    """Measures position in its own frame."""

    type: Literal["lidar"] = Field("lidar", description="The kind of sensor.")
    position_sigma_m: float = Field(
        gt=0,
        le=1000,
        description="Standard deviation of the position along each axis of the sensor's frame, m.",
    )
    x_bias_m: float = Field(0, description="Constant error along the boresight, m.")
    y_bias_m: float = Field(0, description="Constant error to the left of the boresight, m.")


#: Each kind of sensor.
Sensor = RadarConfig | SpeedRadarConfig | LidarConfig
AnySensor = Annotated[Sensor, Field(discriminator="type")]

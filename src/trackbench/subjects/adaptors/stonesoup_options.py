"""The options of a tracker that runs a predictor and an updater of Stone Soup; to read them it is not needed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from trackbench.base.config import Problem
from trackbench.subjects.adaptors.options import AdaptorOptions, SensorOptions, sensor_problems


class StoneSoupSensor(SensorOptions):
    """How the measurements of a sensor are given to the updater."""

    measurement_model: str | None = Field(None, description="own, or a measurement model, as module:name.")
    pose: Literal["stated", "own"] | None = Field(None, description="Whether the model is put where the sensor is.")

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        for key in ("R", "pose"):
            if getattr(self, key) is not None and self.measurement_model is None:
                yield Problem((key,), "not used without measurement_model")


class StoneSoupOptions(AdaptorOptions):
    """The keys under ``options`` where a scenario says ``use: stonesoup``."""

    package = "stonesoup"
    library = "Stone Soup"

    pair: str = Field(description='predictor and updater, or a function that makes them, as "module:name"')
    pair_options: dict[str, Any] = Field(default_factory=dict, description="Arguments of a function that makes them.")
    sensors: dict[str, StoneSoupSensor] | None = Field(
        None, min_length=1, description="By name or kind, how a sensor's measurements are given to the updater."
    )

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from sensor_problems(self.sensors or {})

"""The options of a tracker that runs a filter of FilterPy; to read them it is not needed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import nearest
from trackbench.base.types import Scan
from trackbench.subjects.adaptors.options import AdaptorOptions, SensorOptions, sensor_problems


class FilterPySensor(SensorOptions):
    """How the measurements of a sensor are given to the filter; functions are called as FilterPy calls them."""

    hx: str | None = Field(None, description="own, or the function that gives the expected measurement.")
    HJacobian: str | None = Field(None, description="The function that gives its derivative, as module:name.")
    residual: str | None = Field(None, description="The function that subtracts two measurements, as module:name.")
    z_mean: str | None = Field(None, description="The function that averages sigma points, as module:name.")
    args: list[str] = Field(default_factory=list, description="Fields of the scan that hx is given beside the state.")

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        for index, name in enumerate(self.args):
            if name not in Scan._fields:
                yield Problem(("args", index), f"a scan has no {name!r}: {nearest(name, Scan._fields)}")
        for key in ("HJacobian", "residual", "z_mean", "args"):
            if key in self.model_fields_set and self.hx is None:
                yield Problem((key,), "not used without hx")


class FilterPyOptions(AdaptorOptions):
    """The keys under ``options`` where a scenario says ``use: filterpy``."""

    package = "filterpy"
    library = "FilterPy"

    filter: str = Field(description='the filter, or a function that makes one, as "module:name"')
    filter_options: dict[str, Any] = Field(default_factory=dict, description="Arguments of a function that makes it.")
    transition: str | None = Field(None, description="Function that gives F, of dt or of x and dt, as module:name.")
    fx: str | None = Field(None, description="Function that gives the state after dt, as module:name.")
    process_noise: str | None = Field(None, description="Function that gives Q, of dt or of x and dt, as module:name.")
    sensors: dict[str, FilterPySensor] | None = Field(
        None, min_length=1, description="By name or kind, how a sensor's measurements are given to the filter."
    )

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        yield from sensor_problems(self.sensors or {})
        if self.fx is not None and self.transition is None:
            yield Problem(("transition",), "missing: beside fx it gives the Jacobian of fx")

"""Motion, and perhaps measurements, from a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field

from trackbench.config import Name, Positive, Problem
from trackbench.truth.base import TruthSource
from trackbench.truth.config.columns import MeasurementColumns, TruthColumns, Units
from trackbench.truth.config.observer import FixedObserver

TABLES = ("csv", "parquet")


class RecordingOptions(TruthSource):
    """Motion from a file, and measurements where it has them."""

    format: Literal["udacity", "csv", "parquet"] = Field(
        description="udacity: text of the Udacity simulator, whose L lines feed the sensor of type lidar and whose R "
        "lines that of type radar. csv (with a line of column names) and parquet: tables, one row for each time and "
        "object."
    )
    path: str = Field(
        min_length=1,
        description="The file. A relative path starts in the scenario's folder, or in the working directory; "
        "environment variables such as $TRACKBENCH_DATA are filled in.",
    )
    columns: TruthColumns | None = Field(None, description="csv and parquet, required there: names of the columns.")
    units: Units = Field(default_factory=Units, description="csv and parquet: units of the columns.")
    measurements: dict[Name, MeasurementColumns] = Field(
        default_factory=dict,
        alias="readings",
        description="csv and parquet: recorded measurements, by sensor; those of other sensors are synthesised.",
    )
    observer: FixedObserver = Field(default_factory=FixedObserver, description="The fixed point with the sensors.")
    length_m: Positive = Field(4.5, description="Length of every object, m, to draw it.")
    width_m: Positive = Field(1.8, description="Width of every object, m, to draw it.")

    def feeds(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Those of the sensors, given by name with their kinds, whose measurements are recorded."""
        if self.format == "udacity":
            return {name: kind for name, kind in kinds.items() if kind in ("lidar", "radar")}
        return {name: kind for name, kind in kinds.items() if name in self.measurements}

    def problems(self) -> Iterator[Problem]:
        if self.format in TABLES:
            if self.columns is None:
                yield Problem(("columns",), f"missing: format {self.format} needs the names of its columns")
            elif self.columns.observer is not None and "observer" in self.model_fields_set:
                yield Problem(("observer",), "not used with columns.observer; remove one of them")
            return
        for name, key in (("columns", "columns"), ("units", "units"), ("measurements", "readings")):
            if name in self.model_fields_set:
                yield Problem((key,), f"format {self.format} has fixed columns and units; remove this")

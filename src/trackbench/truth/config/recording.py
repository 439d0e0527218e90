"""Motion, and perhaps measurements, from a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import ConfigDict, Field

from trackbench.config import Config, Name, Positive, Problem
from trackbench.truth.base import TruthSource
from trackbench.truth.config.observer import FixedObserver

#: The two ways to state a velocity.
VELOCITY = (("vx", "vy"), ("speed", "course"))
TABLES = ("csv", "parquet")


class Units(Config):
    """The units of all columns."""

    time: Literal["s", "ms", "us", "ns"] = Field("s", description="Of times; the first instant becomes 0 s.")
    length: Literal["m", "km", "cm", "mm", "ft"] = Field("m", description="Of positions and ranges.")
    speed: Literal["mps", "kmph", "mph"] = Field("mps", description="Of velocities and range rates.")
    angle: Literal["rad", "deg"] = Field("rad", description="Of angles, and per second of turn rates.")


class ObserverColumns(Config):
    """Columns with the motion of what carries the sensors, the same for all objects at one time."""

    px: str = Field(description="Position along x in the fixed frame.")
    py: str = Field(description="Position along y in the fixed frame.")
    yaw: str = Field(description="Heading, counter-clockwise from x.")
    vx: str = Field(description="Velocity along x in the fixed frame.")
    vy: str = Field(description="Velocity along y in the fixed frame.")
    yaw_rate: str | None = Field(None, description="Rate of change of the heading; zero unless given.")


class TruthColumns(Config):
    """Names of the columns that hold the true motion. The velocity is vx and vy, or speed and course."""

    time: str = Field(description="Time.")
    object: str | None = Field(None, description="Name of the object; all rows are of one object unless given.")
    px: str = Field(description="Position along x in the fixed frame.")
    py: str = Field(description="Position along y in the fixed frame.")
    vx: str | None = Field(None, description="Velocity along x in the fixed frame.")
    vy: str | None = Field(None, description="Velocity along y in the fixed frame.")
    speed: str | None = Field(None, description="Speed along the course.")
    course: str | None = Field(None, description="Direction of motion, counter-clockwise from x.")
    heading: str | None = Field(
        None, description="Direction in which the body points, counter-clockwise from x; the course unless given."
    )
    yaw_rate: str | None = Field(
        None, description="Rate of change of the heading; from the differences of the heading unless given."
    )
    observer: ObserverColumns | None = Field(
        None, description="Motion of what carries the sensors, where it is recorded; otherwise truth.observer."
    )

    def problems(self) -> Iterator[Problem]:
        given = [pair for pair in VELOCITY if any(getattr(self, key) is not None for key in pair)]
        if len(given) != 1:
            how = "is given twice" if given else "is missing"
            yield Problem((), f"the velocity {how}: write vx and vy, or speed and course")
            return
        for key in given[0]:
            if getattr(self, key) is None:
                yield Problem((key,), f"missing: a velocity is {' and '.join(given[0])}")


class MeasurementColumns(Config):
    """Names of the columns that hold a sensor's measurements; where they are empty, it did not detect the object.

    Beside the keys below there is one for each component of the sensor's measurement: range, azimuth and range_rate of
    a radar, range, azimuth and speed of a speed_radar, x and y of a lidar (`trackbench list sensors` shows them).
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    path: str | None = Field(None, description="The file, of the same format; that of the truth unless given.")
    time: str | None = Field(None, description="Time of the measurement; named as in truth.columns unless given.")
    object: str | None = Field(None, description="Name of the object; named as in truth.columns unless given.")

    @property
    def components(self) -> dict[str, str]:
        """The column of each component of a measurement that is given."""
        return dict(self.__pydantic_extra__)


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

"""Options of a recorded truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field

from trackbench.base.config import Angle, Config, Name, Positive, Problem
from trackbench.truth.base import TruthSource
from trackbench.truth.config.columns import MeasurementColumns, ObserverColumns, TruthColumns, Units
from trackbench.truth.jumps import Position, Velocity


class FixedObserver(Config):
    """A point beside the road that carries the sensors.

    The fixed frame is highway-env's with its y turned up, so that angles count counter-clockwise from above.
    """

    x: Position = Field(0, description="Position along x in the fixed frame, m.")
    y: Position = Field(0, description="Position along y in the fixed frame, m.")
    yaw_deg: Angle = Field(0, description="Heading in the fixed frame, counter-clockwise from x, degrees.")


class MovingObserver(FixedObserver):
    """A point that carries the sensors, at rest or in straight and steady motion, which may turn as it goes."""

    vx_mps: Velocity = Field(0, description="Velocity along x in the fixed frame, m/s.")
    vy_mps: Velocity = Field(0, description="Velocity along y in the fixed frame, m/s.")
    turn_rate_degps: float = Field(
        0, ge=-720, le=720, description="Rate of change of the heading, counter-clockwise, degrees per second."
    )


TABLES = ("csv", "parquet")


class RecordingOptions(TruthSource):
    """Motion from a file, and measurements where it has them."""

    format: Literal["udacity", "csv", "parquet"] = Field(
        description="udacity: text of the Udacity simulator, whose L lines feed the sensor of type lidar and whose R "
        "lines that of type radar. csv (with a line of column names) and parquet: tables, one row for each time and "
        "object."
    )
    path: str | None = Field(
        None,
        min_length=1,
        description="The file. A relative path starts in the scenario's folder, or in the working directory; "
        "environment variables such as $TRACKBENCH_DATA are filled in. csv and parquet: may be left out where the "
        "identities are hidden; then there is no truth, and every sensor's measurements have a file of their own.",
    )
    columns: TruthColumns | None = Field(None, description="csv and parquet, required there: names of the columns.")
    units: Units = Field(default_factory=Units, description="csv and parquet: units of the columns.")
    measurements: dict[Name, MeasurementColumns] = Field(
        default_factory=dict,
        alias="readings",
        description="csv and parquet: recorded measurements, by sensor; those of other sensors are synthesised.",
    )
    ego: ObserverColumns | None = Field(
        None,
        description="csv and parquet without a truth: the recorded motion of what carries the sensors, in a file of "
        "its own; otherwise observer. Beside a truth it is columns.observer.",
    )
    observer: FixedObserver = Field(default_factory=FixedObserver, description="The fixed point with the sensors.")
    length_m: Positive = Field(4.5, description="Length of every object, m, to draw it.")
    width_m: Positive = Field(1.8, description="Width of every object, m, to draw it.")

    def feeds(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Those of the sensors, given by name with their kinds, whose measurements are recorded."""
        if self.format == "udacity":
            return {name: kind for name, kind in kinds.items() if kind in ("lidar", "radar")}
        return {name: kind for name, kind in kinds.items() if name in self.measurements}

    @property
    def without_truth(self) -> bool:
        """Whether there are measurements alone."""
        return self.path is None

    def problems(self) -> Iterator[Problem]:
        if self.without_truth:
            yield from self._problems_without_truth()
            return
        if self.ego is not None:
            yield Problem(("ego",), "with a truth the observer's columns are columns.observer; move them there")
        if self.format in TABLES:
            if self.columns is None:
                yield Problem(("columns",), f"missing: format {self.format} needs the names of its columns")
            elif self.columns.observer is not None and "observer" in self.model_fields_set:
                yield Problem(("observer",), "not used with columns.observer; remove one of them")
            return
        for name, key in (("columns", "columns"), ("units", "units"), ("measurements", "readings")):
            if name in self.model_fields_set:
                yield Problem((key,), f"format {self.format} has fixed columns and units; remove this")

    def _problems_without_truth(self) -> Iterator[Problem]:
        if self.format not in TABLES:
            yield Problem(("path",), f"missing: the file of format {self.format}")
            return
        if self.columns is not None:
            yield Problem(("path",), "missing: the file whose columns are named in columns")
            return
        if not self.measurements:
            yield Problem(("path",), "missing: the file with the truth; without a truth, readings name measurements")
        for name, entry in self.measurements.items():
            for key in ("path", "time"):
                if getattr(entry, key) is None:
                    yield Problem(
                        ("readings", name, key), "missing: without a truth, each sensor has a file of its own"
                    )
            if entry.object is not None:
                message = "names an object of the truth, and there is none; the sensor's own number of a track is slot"
                yield Problem(("readings", name, "object"), message)
        if self.ego is None:
            return
        if "observer" in self.model_fields_set:
            yield Problem(("observer",), "not used with ego; remove one of them")
        for key in ("path", "time"):
            if getattr(self.ego, key) is None:
                yield Problem(("ego", key), "missing: without a truth, the observer has a file of its own")

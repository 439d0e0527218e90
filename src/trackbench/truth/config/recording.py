"""Options of a recording: its files, and what is read from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr

from trackbench.base.config import Angle, Config, KeyPath, Name, Positive, Problem
from trackbench.base.errors import counted
from trackbench.models.sensors import sensor_type
from trackbench.truth.base import MAX_SCENES, TruthSource
from trackbench.truth.config.columns import (
    MeasurementColumns,
    ObserverColumns,
    ReferenceOptions,
    TruthColumns,
)
from trackbench.truth.config.logs import Paths, log_names
from trackbench.truth.jumps import Position, Velocity


class FixedObserver(Config):
    """Fixed point beside the road with the sensors.

    The fixed frame is highway-env's with y reversed, so that angles count counter-clockwise from above.
    """

    x: Position = Field(0, description="Position along x in the fixed frame, m.")
    y: Position = Field(0, description="Position along y in the fixed frame, m.")
    yaw_deg: Angle = Field(0, description="Heading in the fixed frame, counter-clockwise from x, degrees.")


class MovingObserver(FixedObserver):
    """Point that carries the sensors, at rest or in straight and steady motion; its heading may turn."""

    vx_mps: Velocity = Field(0, description="Velocity along x in the fixed frame, m/s.")
    vy_mps: Velocity = Field(0, description="Velocity along y in the fixed frame, m/s.")
    turn_rate_degps: float = Field(
        0, ge=-720, le=720, description="Rate of change of the heading, counter-clockwise, degrees per second."
    )


TABLES = ("csv", "parquet")


class ReferenceTruth(TruthSource):
    """Truth source of recorded reference boxes."""

    observer: FixedObserver = Field(default_factory=FixedObserver, description="The fixed point with the sensors.")
    length_m: Positive = Field(4.5, description="Length of every object of which the file does not state it, m.")
    width_m: Positive = Field(1.8, description="Width of every object of which the file does not state it, m.")
    reference: ReferenceOptions = Field(default_factory=ReferenceOptions, description="Which objects are scored.")
    stretches: int | None = Field(
        None,
        ge=2,
        le=MAX_SCENES,
        description="With hidden identities: into how many stretches of time the scores of each log are cut, so that "
        "one log gives intervals and can be held out in part. Trackers go through the whole log once.",
    )

    @property
    def number_of_logs(self) -> int:
        """Number of recorded drives (logs), each of which is a scene."""
        return 1

    @property
    def counted_stretches(self) -> list[tuple[int, int]]:
        return [(log, number) for log in range(self.number_of_logs) for number in range(self.stretches or 0)]


class RecordingOptions(ReferenceTruth):
    """Options of a recording: motion from a file, and measurements if the file has them."""

    format: Literal["udacity", "csv", "parquet"] = Field(
        description="udacity: text of the Udacity simulator, whose L lines feed the sensor of type lidar and whose R "
        "lines that of type radar. csv (with a line of column names) and parquet: tables, one row for each time and "
        "object."
    )
    path: Paths | None = Field(
        None,
        description="The file; of several logs a list of files. Each log is a scene; other files are then lists "
        "too, one file for each log in the same order. csv and parquet: may be left out where the identities are "
        "hidden; then there is no truth, and every sensor's measurements have a file of their own.",
    )
    columns: TruthColumns | None = Field(None, description="csv and parquet, required there: the columns.")
    measurements: dict[Name, MeasurementColumns] = Field(
        default_factory=dict,
        alias="readings",
        description="csv and parquet: recorded measurements, by sensor; those of other sensors are synthesised.",
    )
    ego: ObserverColumns | None = Field(
        None,
        description="csv and parquet: the recorded motion of what carries the sensors, in a file of its own; otherwise "
        "observer.",
    )
    _hidden: bool = PrivateAttr(False)
    _every: slice = PrivateAttr(slice(None))

    @property
    def hidden(self) -> bool:
        """Whether trackers are not told the objects of detections."""
        return self._hidden

    def with_hidden_identities(self) -> Self:
        return self._with(_hidden=True)

    def every_second(self, first: int) -> Self:
        """Return the recording with every second log from index ``first``, or every second stretch if logs are cut."""
        return self._with(_every=slice(first, None, 2))

    @property
    def number_of_logs(self) -> int:
        """Number of logs; each has one file of the truth, the observer and each sensor."""
        return max((len(path) for path in self._paths().values() if isinstance(path, list)), default=1)

    def scenes(self) -> Sequence[Self]:
        paths = [path for path in self._paths().values() if isinstance(path, list)]
        logs = [self._scene(number, name) for number, name in enumerate(log_names(paths[0]))] if paths else [self]
        chosen = logs[self._every] if self.stretches is None else logs
        return tuple(log._with(_every=slice(None)) for log in chosen)

    @property
    def counted_stretches(self) -> list[tuple[int, int]]:
        return super().counted_stretches[self._every]

    def unlabelled(self, sensor: str) -> bool:
        """Return whether the objects of a sensor's recorded detections are unknown."""
        entry = self.measurements[sensor]
        return self.without_truth or (self._hidden and entry.path is not None and entry.object is None)

    def _paths(self) -> dict[KeyPath, str | list[str]]:
        """Return all given paths by the key that holds them; the truth's path comes first."""
        entries: dict[KeyPath, ObserverColumns | MeasurementColumns | RecordingOptions | None] = {
            (): self,
            **{("readings", name): entry for name, entry in self.measurements.items()},
            ("ego",): self.ego,
        }
        return {(*key, "path"): entry.path for key, entry in entries.items() if entry is not None and entry.path}

    def _scene(self, number: int, name: str) -> Self:
        def of_log(entry: Any) -> Any:
            has_list = entry is not None and isinstance(entry.path, list)
            return entry.model_copy(update={"path": entry.path[number]}) if has_list else entry

        update = {
            "measurements": {key: of_log(entry) for key, entry in self.measurements.items()},
            "ego": of_log(self.ego),
        }
        return of_log(self).model_copy(update=update)._with(_scene_name=name)  # type: ignore[no-any-return]

    def _problems_of_logs(self) -> Iterator[Problem]:
        for key, path in self._paths().items():
            count = len(path) if isinstance(path, list) else 1
            if count != self.number_of_logs:
                needed = f"one for each of {self.number_of_logs} logs, in the same order"
                yield Problem(key, f"{counted(count, 'file')}, where there must be {needed}")

    def feeds(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Return the part of ``kinds`` (type of sensor by name) for which the files have measurements."""
        if self.format == "udacity":
            return {name: kind for name, kind in kinds.items() if sensor_type(kind) in ("lidar", "radar")}
        return {name: kind for name, kind in kinds.items() if name in self.measurements}

    @property
    def without_truth(self) -> bool:
        """Whether the recording has measurements but no motion of objects."""
        return self.path is None

    def problems(self) -> Iterator[Problem]:
        yield from self._problems_of_logs()
        if self.ego is not None and "observer" in self.model_fields_set:
            yield Problem(("observer",), "not used with ego; remove one of them")
        yield from self._problems_without_truth() if self.without_truth else self._problems_with_truth()

    def _problems_with_truth(self) -> Iterator[Problem]:
        if self.format not in TABLES:
            unused_keys = ("columns", "measurements", "reference", "ego")
            for name in (name for name in unused_keys if name in self.model_fields_set):
                key = type(self).model_fields[name].alias or name
                yield Problem((key,), f"format {self.format} has fixed columns and units; remove this")
        elif self.columns is None:
            yield Problem(("columns",), f"missing: format {self.format} needs the names of its columns")
        elif self.reference.classes and self.columns.kind is None:
            yield Problem(("columns", "class"), "missing: the column of the class, for reference.classes")

    def _problems_without_truth(self) -> Iterator[Problem]:
        if self.columns is not None or "reference" in self.model_fields_set or not self.measurements:
            message = "missing: the file with the truth; without a truth, readings alone name measurements"
            yield Problem(("path",), message)
        for name, entry in self.measurements.items():
            if entry.path is None or entry.time is None or entry.object is not None:
                message = "without a truth, it has a path and a time of its own, and slot instead of object"
                yield Problem(("readings", name), message)
        if self.ego is not None and self.ego.time is None:
            yield Problem(("ego", "time"), "missing: without a truth, the observer has its own column of times")

"""Truth and measurements from tables whose columns and units the scenario names."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path

import numpy as np

from trackbench.errors import InputError, nearest
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth.config import RecordingOptions
from trackbench.truth.config.recording import (
    MeasurementColumns,
    ObserverColumns,
    TruthColumns,
    Units,
)
from trackbench.truth.recorded import assemble, files, rows
from trackbench.truth.recorded.assemble import Log, Motion
from trackbench.truth.recorded.rows import Rows
from trackbench.types import Array, Observer, RecordedMeasurements, Truth

#: What the object is called where the file does not name it.
OBJECT = "object"

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
METRES = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
METRES_PER_SECOND = {"mps": 1.0, "kmph": 1 / 3.6, "mph": 0.44704}
RADIANS = {"rad": 1.0, "deg": np.pi / 180}

#: The SI unit of the columns that are no angles (per second).
MOTION_UNITS = {**dict.fromkeys(("px", "py"), "m"), **dict.fromkeys(("vx", "vy", "speed"), "m/s")}


def load(
    config: RecordingOptions, kinds: Mapping[str, str], folder: Path
) -> tuple[Truth, dict[str, RecordedMeasurements]]:
    """The truth of all objects, and the measurements of the sensors whose columns are named.

    Raises:
        InputError: a file cannot be read, or a row of it is damaged.
    """
    assert config.columns is not None
    columns = config.columns
    file = files.find(config.path, folder, "truth.path")
    inside = [entry for entry in config.measurements.values() if entry.path is None]
    table = rows.read(file, config.format, [*_names(columns), *(c for e in inside for c in _own(e, columns))])
    stamps = table.times(columns.time)
    start = stamps[0]
    seconds = _seconds(stamps, start, config.units)
    motions = _motions(table, columns, seconds, config.units)
    logs = {}
    for name, entry in config.measurements.items():
        source, times = table, seconds
        if entry.path is not None or entry.time is not None:
            if entry.path is not None:
                other = files.find(entry.path, folder, f"truth.readings.{name}.path")
                source = rows.read(other, config.format, _own(entry, columns))
            times = _seconds(source.times(entry.time or columns.time), start, config.units)
        logs[name] = _log(source, entry, columns, times, config.units, SENSOR_MODELS[kinds[name]], motions)
    times = assemble.grid([motion.time for motion in motions.values()] + [log.time for log in logs.values()])
    observer = None if columns.observer is None else _observer(table, columns.observer, seconds, times, config.units)
    truth = assemble.truth(config, motions, logs, observer, times, {"file": file.name, "rows": len(table)})
    return truth, {name: assemble.measurements(log, kinds[name], times, len(motions)) for name, log in logs.items()}


def _names(columns: TruthColumns) -> list[str]:
    own = columns.model_dump(exclude={"observer"}, exclude_none=True)
    observer = columns.observer.model_dump(exclude_none=True) if columns.observer is not None else {}
    return [*own.values(), *observer.values()]


def _own(entry: MeasurementColumns, columns: TruthColumns) -> list[str]:
    named = [entry.time or columns.time, entry.object or columns.object, *entry.components.values()]
    return [name for name in named if name is not None]


def _motions(table: Rows, columns: TruthColumns, seconds: Array, units: Units) -> dict[str, Motion]:
    value = {
        name: _scaled(table.numbers(column), name, units)
        for name, column in columns.model_dump(exclude={"time", "object", "observer"}, exclude_none=True).items()
    }
    if "speed" in value:
        speed, course = value.pop("speed"), value.pop("course")
        value |= {"vx": speed * np.cos(course), "vy": speed * np.sin(course)}
    names = [OBJECT] * len(table) if columns.object is None else table.names(columns.object)
    members: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        before = members.setdefault(name, [])
        if before and seconds[row] == seconds[before[-1]]:
            raise table.error(row, f"a second row of {name} at the same time")
        before.append(row)
    return {name: Motion(seconds[own], **{key: v[own] for key, v in value.items()}) for name, own in members.items()}


def _log(
    table: Rows,
    entry: MeasurementColumns,
    columns: TruthColumns,
    seconds: Array,
    units: Units,
    sensor: type[Sensor],
    motions: Mapping[str, Motion],
) -> Log:
    named, components = entry.components, sensor.components
    measurement = np.stack(
        [
            _converted(table.numbers(named[name], optional=True), unit, units)
            for name, unit in zip(components, sensor.units, strict=True)
        ]
    )
    there = np.isfinite(measurement)
    for row in np.flatnonzero(there.any(axis=0) & ~there.all(axis=0)).tolist():
        missing = named[components[int(np.argmin(there[:, row]))]]
        raise table.error(row, f"{missing} is empty, but other columns of the same measurement are not")
    kept = np.flatnonzero(there.all(axis=0))
    if not len(kept):
        raise InputError(f"there is no measurement in {', '.join(named.values())}", file=table.file)
    column = entry.object or columns.object
    ids = list(motions)
    names = [ids[0]] * len(table) if column is None else table.names(column)
    seen: set[tuple[float, str]] = set()
    for measurement_row in kept.tolist():
        _check_measurement(
            table, measurement_row, names[measurement_row], float(seconds[measurement_row]), motions, seen
        )
    return Log(seconds[kept], np.array([ids.index(names[row]) for row in kept], dtype=np.intp), measurement[:, kept])


def _check_measurement(
    table: Rows, row: int, name: str, time: float, motions: Mapping[str, Motion], seen: set[tuple[float, str]]
) -> None:
    if name not in motions:
        raise table.error(row, f"the truth has no object {name!r}; {nearest(name, motions)}")
    if (time, name) in seen:
        raise table.error(row, f"a second measurement of {name} at the same time")
    seen.add((time, name))
    known = motions[name].time
    if not known[0] <= time <= known[-1]:
        span = f"from {known[0]:g} to {known[-1]:g} s after the recording's start"
        raise table.error(row, f"a measurement of {name} at {time:g} s, where its truth is not known ({span})")


def _observer(table: Rows, columns: ObserverColumns, seconds: Array, times: Array, units: Units) -> Observer:
    known, first = np.unique(seconds, return_index=True)
    value = {
        name: _scaled(table.numbers(column), name, units)
        for name, column in columns.model_dump(exclude_none=True).items()
    }
    for name, column in value.items():
        held = np.repeat(column[first], np.diff([*first, len(column)]))
        for row in np.flatnonzero(column != held).tolist():
            raise table.error(row, f"{getattr(columns, name)} differs from that of the same time in a row before")
    value["yaw"] = np.unwrap(value["yaw"])
    value.setdefault("yaw_rate", np.zeros_like(seconds))
    at = {name: np.interp(times, known, column[first]) for name, column in value.items()}
    return Observer(at["px"], at["py"], at["yaw"], at["vx"], at["vy"], at["yaw_rate"])


def _seconds(stamps: list[Decimal], start: Decimal, units: Units) -> Array:
    return np.array([float(stamp - start) for stamp in stamps]) * SECONDS[units.time]


def _scaled(values: Array, name: str, units: Units) -> Array:
    return _converted(values, MOTION_UNITS.get(name, "rad"), units)


def _converted(values: Array, unit: str, units: Units) -> Array:
    factors = {"m": METRES[units.length], "m/s": METRES_PER_SECOND[units.speed], "rad": RADIANS[units.angle]}
    return values * factors.get(unit, 1.0)

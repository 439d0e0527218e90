"""Reader of files of the Udacity simulator."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.numbers import stated_number
from trackbench.models.sensors import SENSOR_MODELS, sensor_type
from trackbench.truth import jumps
from trackbench.truth.config.logs import find_log
from trackbench.truth.config.recording import RecordingOptions
from trackbench.truth.jumps import LARGEST
from trackbench.truth.recorded.drive import Drive, Log, Motion, row_order
from trackbench.truth.recorded.table_files import log_text

#: Kind of sensor of each letter, and the components of its measurement.
SENSORS: dict[str, tuple[str, tuple[str, ...]]] = {
    "L": ("lidar", ("px", "py")),
    "R": ("radar", ("range", "azimuth", "range rate")),
}
TRUTH = ("true px", "true py", "true vx", "true vy")
#: Columns of the truth that older files lack.
OPTIONAL = ("true yaw", "true yaw rate")
#: Time stamp in whole microseconds, with few enough digits to be exact in a double.
_STAMP = re.compile(r"[0-9]{1,16}")


class Measurement(NamedTuple):
    """Measurement in one line of a Udacity file, with the true state at its time."""

    kind: str
    """Kind of the sensor, "lidar" or "radar"."""
    measurement: tuple[float, ...]
    """x and y, m, of a lidar; range m, azimuth rad (not wrapped) and range rate m/s of a radar."""
    stamp: int
    """Time stamp of the measurement, in microseconds."""
    truth: tuple[float, float, float, float]
    """True px, py, m, and vx, vy, m/s, of the object at the measurement's time."""
    yaw: float | None = None
    """True yaw of the object, rad; None in older files, which do not state it."""
    yaw_rate: float | None = None
    """True yaw rate of the object, rad/s; None in older files, which do not state it."""


def parse_line(text: str) -> Measurement:
    """Return the measurement in a line; columns are separated by white space.

    Raises:
        InputError: unknown letter, missing or surplus column, or a value that is no finite number.
    """
    letter, *columns = text.split() or [""]
    if letter not in SENSORS:
        raise InputError(f"a line begins with L (lidar) or R (radar), not {letter[:20]!r}")
    kind, components = SENSORS[letter]
    names = (*components, "time stamp", *TRUTH, *OPTIONAL)
    size, least = len(components), len(names) - len(OPTIONAL)
    if not least <= len(columns) <= len(names):
        message = f"the {letter} line has {len(columns)} columns after its letter, where {least} to {len(names)} are"
        raise InputError(f"{message} needed: {', '.join(names)}")
    for column, name in zip(columns, names, strict=False):
        if name == "time stamp" and not _STAMP.fullmatch(column):
            raise InputError(f"the time stamp is a whole number of microseconds, not {column[:20]!r}")
        if not abs(stated_number(column)) <= LARGEST["length"] and name != "time stamp":
            raise InputError(f"{name} is not a finite number that can be meant: {column[:20]!r}")
    stamp = int(columns.pop(size))
    values = [float(column) for column in columns]
    px, py, vx, vy, *rest = values[size:]
    return Measurement(kind, tuple(values[:size]), stamp, (px, py, vx, vy), *rest)


OBJECT = "cyclist"


def load_udacity(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Return the object's motion at every line, and the measurements of the sensors of the given kinds.

    Raises:
        InputError: the file cannot be read, or a line is damaged.
    """
    file = find_log(config.path or "", folder, "truth.path")
    measurements = parse_lines(log_text(file), file)
    stamps = np.array([item.stamp for item in measurements], dtype=np.int64)
    seconds = (stamps - stamps[0]) / 1e6
    times, first = np.unique(seconds, return_index=True)
    px, py, vx, vy = np.array([item.truth for item in measurements]).T[:, first]
    yaw = [item.yaw for item in measurements]
    rate = [item.yaw_rate for item in measurements]
    motion = Motion(
        *(times, px, py, vx, vy),
        heading=None if None in yaw else np.array(yaw, dtype=float)[first],
        yaw_rate=None if None in rate else np.array(rate, dtype=float)[first],
    )
    logs = {}
    for name, kind in config.feeds(kinds).items():
        all_components = SENSOR_MODELS[sensor_type(kind)].components
        components = [all_components.index(part) for part in SENSOR_MODELS[kind].components]
        rows = [i for i, item in enumerate(measurements) if item.kind == sensor_type(kind)]
        if not rows:
            raise InputError(f"the file has no line of a {kind}, which sensor {name} is", file=file)
        measurement = np.array([measurements[i].measurement for i in rows]).T[components]
        owner = np.zeros(len(rows), dtype=np.intp)
        logs[name] = Log(seconds[rows], owner, measurement, seconds[rows], row_order(seconds[rows], owner)[1])
    order = row_order(times, np.zeros(len(times), dtype=np.intp))[1]
    return Drive({OBJECT: motion}, order, None, logs, {"file": file.name, "lines": len(measurements)})


def parse_lines(text: str, file: Path) -> list[Measurement]:
    """Return the measurements of all lines that are not blank.

    Raises:
        InputError: a line is damaged, or its time is not later than the sensor's previous time.
    """
    measurements: list[Measurement] = []
    latest: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            item = parse_line(line)
        except InputError as error:
            raise error.located(file=file, line=number) from None
        if measurements and item.stamp - measurements[0].stamp > jumps.LONGEST * 1e6:
            seconds = (item.stamp - measurements[0].stamp) / 1e6
            raise InputError(jumps.why_too_long(seconds), file=file, line=number)
        if measurements and (item.stamp < measurements[-1].stamp or latest.get(item.kind) == item.stamp):
            message = f"a {item.kind} line at {item.stamp} us is out of order, or the second at this time"
            raise InputError(message, file=file, line=number)
        latest[item.kind] = item.stamp
        measurements.append(item)
    return measurements

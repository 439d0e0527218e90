"""A whole recording in the text format of the Udacity simulator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError
from trackbench.truth import limits
from trackbench.truth.config import RecordingOptions
from trackbench.truth.recorded import files
from trackbench.truth.recorded.drive import Drive, Log, Motion, row_order
from trackbench.truth.recorded.udacity import Measurement, parse_line

OBJECT = "cyclist"


def load(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """The one object's truth at every line, and the measurements of the sensors of the given kinds.

    Raises:
        InputError: the file cannot be read, or a line of it is damaged.
    """
    file = files.find(config.path or "", folder, "truth.path")
    measurements = parse(files.read_text(file), file)
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
        rows = [i for i, item in enumerate(measurements) if item.kind == kind]
        if not rows:
            raise InputError(f"the file has no line of a {kind}, which sensor {name} is", file=file)
        measurement, owner = np.array([measurements[i].measurement for i in rows]).T, np.zeros(len(rows), dtype=np.intp)
        logs[name] = Log(seconds[rows], owner, measurement, seconds[rows], row_order(seconds[rows], owner)[1])
    order = row_order(times, np.zeros(len(times), dtype=np.intp))[1]
    return Drive({OBJECT: motion}, order, None, logs, {"file": file.name, "lines": len(measurements)})


def parse(text: str, file: Path) -> list[Measurement]:
    """The measurements of all lines that are not blank.

    Raises:
        InputError: a line is damaged, or its time is not later than that of the sensor's line before.
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
        if measurements and item.stamp < measurements[-1].stamp:
            message = f"time runs backwards: {item.stamp} us after {measurements[-1].stamp} us"
            raise InputError(message, file=file, line=number)
        if measurements and item.stamp - measurements[0].stamp > limits.LONGEST * 1e6:
            seconds = (item.stamp - measurements[0].stamp) / 1e6
            raise InputError(limits.why_too_long(seconds), file=file, line=number)
        if latest.get(item.kind) == item.stamp:
            raise InputError(f"a second {item.kind} line at {item.stamp} us", file=file, line=number)
        latest[item.kind] = item.stamp
        measurements.append(item)
    return measurements

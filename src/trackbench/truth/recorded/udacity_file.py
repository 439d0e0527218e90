"""A whole recording in the text format of the Udacity simulator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from trackbench.errors import InputError
from trackbench.truth.config import RecordingOptions
from trackbench.truth.recorded import assemble, files
from trackbench.truth.recorded.udacity import Measurement, parse_line
from trackbench.types import RecordedMeasurements, Truth

OBJECT = "cyclist"


def load(
    config: RecordingOptions, kinds: Mapping[str, str], folder: Path
) -> tuple[Truth, dict[str, RecordedMeasurements]]:
    """The one object's truth at every line, and the measurements of the sensors of the given kinds.

    Raises:
        InputError: the file cannot be read, or a line of it is damaged.
    """
    file = files.find(config.path, folder, "truth.path")
    measurements = parse(files.read_text(file), file)
    stamps = np.array([item.stamp for item in measurements], dtype=np.int64)
    seconds = (stamps - stamps[0]) / 1e6
    times, first = np.unique(seconds, return_index=True)
    px, py, vx, vy = np.array([item.truth for item in measurements]).T[:, first]
    yaw = [item.yaw for item in measurements]
    rate = [item.yaw_rate for item in measurements]
    motion = assemble.Motion(
        *(times, px, py, vx, vy),
        heading=None if None in yaw else np.array(yaw, dtype=float)[first],
        yaw_rate=None if None in rate else np.array(rate, dtype=float)[first],
    )
    logs = {}
    for name, kind in config.feeds(kinds).items():
        rows = [i for i, item in enumerate(measurements) if item.kind == kind]
        if not rows:
            raise InputError(f"the file has no line of a {kind}, which sensor {name} is", file=file)
        measurement = np.array([measurements[i].measurement for i in rows]).T
        logs[name] = assemble.Log(seconds[rows], np.zeros(len(rows), dtype=np.intp), measurement)
    source = {"file": file.name, "lines": len(measurements)}
    truth = assemble.truth(config, {OBJECT: motion}, logs, None, times, source)
    return truth, {name: assemble.measurements(log, kinds[name], times, 1) for name, log in logs.items()}


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
        if latest.get(item.kind) == item.stamp:
            raise InputError(f"a second {item.kind} line at {item.stamp} us", file=file, line=number)
        latest[item.kind] = item.stamp
        measurements.append(item)
    return measurements

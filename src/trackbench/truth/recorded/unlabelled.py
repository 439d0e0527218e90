"""A log without a truth: the scans of its sensors, and the motion of what carries them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.types import KINEMATICS, Array, Observer, Truth
from trackbench.truth import jumps
from trackbench.truth.base import Recorded
from trackbench.truth.config import RecordingOptions
from trackbench.truth.config.logs import find_log
from trackbench.truth.recorded.drive import carrier, fixed_observer, times_with_observer
from trackbench.truth.recorded.mcap import LogPart
from trackbench.truth.recorded.rows import read_table, seconds_from, time_stamps
from trackbench.truth.recorded.scans import columns_of, recorded_detections, scan_notes, scans_of
from trackbench.truth.recorded.table import observer_motion


def load_unlabelled(
    config: RecordingOptions, kinds: Mapping[str, str], folder: Path
) -> tuple[Truth, dict[str, Recorded], tuple[str, ...]]:
    """A truth without objects, the detections of each sensor, and what was left out, a line each.

    Raises:
        InputError: a file cannot be read or is damaged, with its name and line (row, where there are no lines).
    """
    tables = {
        name: read_table(
            find_log(entry.path or "", folder, f"truth.readings.{name}.path"),
            config.format,
            columns_of(entry),
            LogPart("detections", entry.topic),
        )
        for name, entry in config.measurements.items()
    }
    stamps = {
        name: time_stamps(tables[name], entry.time or "", config.units.factor("time", entry.units.get("time")))
        for name, entry in config.measurements.items()
    }
    start = min(min(of) for of in stamps.values())
    result = {}
    for name, entry in config.measurements.items():
        at = seconds_from(start, stamps[name])
        if at.max() > jumps.LONGEST:
            row = int(np.argmax(at))
            raise tables[name].error(row, f"{entry.time}: {jumps.why_too_long(at[row])}")
        result[name] = scans_of(tables[name], entry, at + entry.time_offset_s, config.units, kinds[name])
    times = np.unique(np.concatenate([of.time for of in result.values()]))
    observer = fixed_observer(config.observer, len(times))
    if config.ego is not None:
        columns, units = config.ego, config.units
        file = find_log(columns.path or "", folder, "truth.ego.path")
        table = read_table(
            file, config.format, [columns.time, *columns.given.values()], LogPart("frame", columns.frame)
        )
        own_stamps = time_stamps(table, columns.time or "", units.factor("time", columns.units.get("time")))
        motion = observer_motion(table, columns, seconds_from(start, own_stamps), units)
        times = times_with_observer(times, motion, "measurements", "truth.ego")
        observer = carrier(motion, times)
    recorded: dict[str, Recorded] = {name: recorded_detections(of, times) for name, of in result.items()}
    return _no_objects(config, times, observer), recorded, tuple(scan_notes(result, times, "observer"))


def _no_objects(config: RecordingOptions, times: Array, observer: Observer) -> Truth:
    kinematics: dict[str, Any] = dict.fromkeys(KINEMATICS, np.zeros((len(times), 0, 1)))
    return Truth(
        time=times,
        ids=(),
        **kinematics,
        alive=np.zeros((len(times), 0), dtype=bool),
        length=np.zeros(0),
        width=np.zeros(0),
        observer=observer,
        source={"source": "recording", "format": config.format, "recorded": list(config.measurements)},
        known=False,
    )

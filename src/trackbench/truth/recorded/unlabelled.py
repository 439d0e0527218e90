"""A log of detections of which nothing says what caused them: the scans, and the motion of what carries the sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import counted
from trackbench.base.types import KINEMATICS, Array, Indices, Mask, Observer, RecordedDetections, Truth
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth import jumps
from trackbench.truth.base import Recorded
from trackbench.truth.config import RecordingOptions
from trackbench.truth.config.columns import POLAR, MeasurementColumns
from trackbench.truth.config.logs import find
from trackbench.truth.recorded.drive import carrier, cycles, fixed, row_order, within
from trackbench.truth.recorded.rows import Rows, read
from trackbench.truth.recorded.table import measured, observer_motion, seconds_from, time_stamps

#: A slot that was empty for longer has another object afterwards, s.
EMPTY_SLOT = 1.0


class _Scans(NamedTuple):
    """Of one sensor, sorted by time."""

    time: Array
    """``(scans,)`` the first instant of each cycle, s."""
    scan: Indices
    """``(rows,)``"""
    measurement: Array
    """``(m, rows)``, angles wrapped."""
    own_track: Indices
    """``(rows,)``"""
    own_tracks: tuple[str, ...]
    rows: int
    """In the file."""
    duplicates: int
    """Rows of the same slot at the same time as a row before, which are left out."""
    copies: int = 0
    """Detections beside another of the same object, which are left out."""


def load(
    config: RecordingOptions, kinds: Mapping[str, str], folder: Path
) -> tuple[Truth, dict[str, Recorded], tuple[str, ...]]:
    """A truth without objects, the detections of each sensor, and what was left out, a line each.

    Raises:
        InputError: a file cannot be read or is damaged, with its name and line (row, where there are no lines).
    """
    tables = {
        name: read(find(entry.path or "", folder, f"truth.readings.{name}.path"), config.format, _own(entry))
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
        result[name] = _scans(tables[name], entry, at + entry.time_offset_s, config, kinds[name])
    times = np.unique(np.concatenate([of.time for of in result.values()]))
    observer = fixed(config.observer, len(times))
    if config.ego is not None:
        columns, units = config.ego, config.units
        file = find(columns.path or "", folder, "truth.ego.path")
        table = read(file, config.format, [columns.time or "", *columns.given.values()])
        own_stamps = time_stamps(table, columns.time or "", units.factor("time", columns.units.get("time")))
        motion = observer_motion(table, columns, seconds_from(start, own_stamps), units)
        times = within(times, motion, "measurements", "truth.ego")
        observer = carrier(motion, times)
    detections: dict[str, Recorded] = {name: _detections(of, times) for name, of in result.items()}
    return _no_objects(config, times, observer), detections, tuple(_notes(result, times))


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


def _own(entry: MeasurementColumns) -> list[str]:
    named = [entry.time, entry.slot, entry.new_track, *entry.components.values()]
    return [name for name in named if name is not None]


def _scans(table: Rows, entry: MeasurementColumns, at: Array, config: RecordingOptions, kind: str) -> _Scans:
    model = SENSOR_MODELS[kind]
    measurement, detected = measured(table, entry, config.units, model)
    names = [""] * len(table) if entry.slot is None else table.names(entry.slot)
    slots = list(dict.fromkeys(names[row] for row in detected.tolist()))
    number = {name: i for i, name in enumerate(slots)}
    slot = np.array([number[names[row]] for row in detected.tolist()], dtype=np.intp)
    new = np.zeros(len(detected), dtype=bool)
    if entry.new_track is not None:
        flags = table.numbers(entry.new_track, 1.0, None)
        for row in np.flatnonzero((flags != 0) & (flags != 1)).tolist():
            raise table.error(row, f"{entry.new_track} is {flags[row]:g}, where 0 or 1 is expected")
        new = flags[detected] == 1
    # Without slots two equal rows are two detections.
    kept, order = row_order(at[detected], np.arange(len(detected)) if entry.slot is None else slot)
    time, slot, new = at[detected][kept], slot[kept], new[kept]
    looked = cycles(time, slot, np.unique(at)) if entry.slot is not None else None
    instants = np.unique(at) if looked is None else looked.instants
    cycle = np.arange(len(instants)) if looked is None else looked.cycle
    _, first, of_instant = np.unique(cycle, return_index=True, return_inverse=True)
    scan = of_instant[np.searchsorted(instants, time)]
    values = measurement[:, kept]
    for i in model.angular:
        values[i] = wrap_angle(values[i])
    own_track, own_tracks = np.full(len(time), -1), list[str]()
    if entry.slot is not None:
        own_track, own_tracks = _tracks_of_slots(time, slot, new, slots)
    result = _Scans(instants[first], scan, values, own_track, tuple(own_tracks), len(table), order.duplicates)
    return result if entry.copies_within_m is None else _without_copies(result, time, model, entry.copies_within_m)


def _tracks_of_slots(time: Array, slot: Indices, new: Mask, names: list[str]) -> tuple[Indices, list[str]]:
    """The number of the sensor's own track of each row, and their names: the slot and how many it had before.

    A slot has another track from a row on that says so, and where it was empty for longer than ``EMPTY_SLOT``.
    """
    result, tracks = np.full(len(time), -1), list[str]()
    for number, name in enumerate(names):
        own = np.flatnonzero(slot == number)
        begins = new[own] | (np.diff(time[own], prepend=-np.inf) > EMPTY_SLOT)
        result[own] = len(tracks) + np.cumsum(begins) - 1
        tracks += [f"{name}-{count + 1}" for count in range(int(begins.sum()))]
    return result, tracks


def _without_copies(of: _Scans, time: Array, model: type[Sensor], within: float) -> _Scans:
    """Of detections of one scan that are near each other, only that of the sensor's older track."""
    first, second = of.measurement[:2]
    polar = model.components[:2] == POLAR
    position = np.stack([first * np.cos(second), first * np.sin(second)] if polar else [first, second])
    began = np.full(len(time), 0.0)
    for track in range(len(of.own_tracks)):
        own = of.own_track == track
        began[own] = time[own][0]
    order = np.lexsort((began, of.scan))
    kept = np.ones(len(time), dtype=bool)
    for rows_of_scan in np.split(order, np.flatnonzero(np.diff(of.scan[order])) + 1):
        older: list[int] = []
        for row in rows_of_scan.tolist():
            away = position[:, older] - position[:, [row]]
            kept[row] = not np.any(np.hypot(*away) < within)
            older += [row] if kept[row] else []
    return of._replace(
        scan=of.scan[kept],
        measurement=of.measurement[:, kept],
        own_track=of.own_track[kept],
        copies=int((~kept).sum()),
    )


def _notes(result: Mapping[str, _Scans], times: Array) -> Iterator[str]:
    for name, of in result.items():
        outside = int((~np.isin(of.time, times))[of.scan].sum())
        if of.duplicates:
            what = "of a slot and a time that came before (left out)"
            yield f"{name}: of {counted(of.rows, 'row')}, {of.duplicates} {what}"
        if of.copies:
            yield f"{name}: of {counted(of.rows, 'row')}, {of.copies} copies of another of their cycle (left out)"
        if outside:
            yield f"{name}: of {counted(of.rows, 'row')}, {outside} outside the time of the observer (left out)"


def _detections(of: _Scans, times: Array) -> RecordedDetections:
    kept = np.isin(of.time, times)
    number = np.cumsum(kept) - 1
    there = kept[of.scan]
    return RecordedDetections(
        np.searchsorted(times, of.time[kept]),
        number[of.scan[there]],
        of.measurement[:, there],
        of.own_track[there],
        of.own_tracks,
    )

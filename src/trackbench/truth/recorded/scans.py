"""Measurements read from a sensor's table, and scans of detections whose objects are unknown."""

from __future__ import annotations

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Mask, RecordedDetections
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth.config.columns import POLAR, Column, MeasurementColumns
from trackbench.truth.recorded.cycles import MOST_MISSED, cycles
from trackbench.truth.recorded.drive import Scans, row_order
from trackbench.truth.recorded.rows import Rows

#: Longest time for which an empty slot keeps its track, s.
EMPTY_SLOT = 1.0
#: Largest ratio of cycles without and with a row, for rows without slots: rows of one scan may be some ms apart, which
#: would otherwise count as many scans.
FEW_MISSED = 0.5


def column_measurements(table: Rows, entry: MeasurementColumns, sensor: type[Sensor]) -> tuple[Array, Indices]:
    """Return the measurements ``(m, n)`` in SI units and radians, and the indices of their rows ``(n,)``.

    Raises:
        InputError: a number is damaged, or no row has a measurement.
    """
    columns = entry.columns(sensor.components, sensor.units)
    values = [
        table.numbers(column, optional=True) - entry.bias.get(name, 0.0) * column.factor
        for name, column in columns.items()
    ]
    names = [column.name for column in columns.values()]
    is_given = np.isfinite(values)
    for row in np.flatnonzero(is_given.any(axis=0) & ~is_given.all(axis=0)).tolist():
        missing = names[int(np.argmin(is_given[:, row]))]
        raise table.error(row, f"{missing} is empty, but other columns of the same measurement are not")
    rows = np.flatnonzero(is_given.all(axis=0))
    if not len(rows):
        raise InputError(f"there is no measurement in {', '.join(names)}", file=table.file)
    measurement = np.stack(values)[:, rows]
    if tuple(columns) != sensor.components:
        x, y = measurement[:2]
        measurement = np.stack([np.hypot(x, y), np.arctan2(y, x), *measurement[2:]])
    return measurement, rows


def position_of(components: tuple[str, ...], measurement: Array) -> Array:
    """Return the measured positions in the sensor's frame, ``(2, n)`` m, of measurements ``(m, n)``."""
    first, second = measurement[:2]
    is_polar = components[:2] == POLAR
    return np.stack([first * np.cos(second), first * np.sin(second)] if is_polar else [first, second])


def scans_of(table: Rows, entry: MeasurementColumns, times: Array, kind: str) -> Scans:
    """Group the unlabelled detections of a sensor into scans.

    Args:
        table: rows of the sensor.
        entry: names of the columns.
        times: ``(rows,)`` time of each row, s.
        kind: kind of the sensor, such as radar.

    Raises:
        InputError: a row is damaged.
    """
    model = SENSOR_MODELS[kind]
    measurement, detected = column_measurements(table, entry, model)
    is_detected = np.zeros(len(table), dtype=bool)
    is_detected[detected] = True
    measured, at_rows = (table, times) if is_detected.all() else (table.only(is_detected), times[is_detected])
    is_new = np.zeros(len(measured), dtype=bool)
    if entry.new_track is not None:
        flags = measured.numbers(Column(entry.new_track))
        for row in np.flatnonzero((flags != 0) & (flags != 1)).tolist():
            raise measured.error(row, f"{entry.new_track} is {flags[row]:g}, where 0 or 1 is expected")
        is_new = flags == 1
    if entry.slot is None:
        # Without slots, equal rows are separate detections.
        slots, slot = [""], np.zeros(len(measured), dtype=np.intp)
        rows, duplicates = np.argsort(at_rows, kind="stable"), 0
    else:
        slots, slot = measured.labels(entry.slot)
        rows, order = row_order(at_rows, slot)
        duplicates = order.duplicates
    time, slot, is_new = at_rows[rows], slot[rows], is_new[rows]
    sensor_cycles = cycles(time, slot, np.unique(times), MOST_MISSED if entry.slot else FEW_MISSED)
    _, first, of_instant = np.unique(sensor_cycles.cycle, return_index=True, return_inverse=True)
    instants = sensor_cycles.instants
    scan = of_instant[np.searchsorted(instants, time)]
    values = measurement[:, rows]
    for i in model.angular:
        values[i] = wrap_angle(values[i])
    own_track, own_tracks = np.full(len(time), -1), list[str]()
    if entry.slot is not None:
        own_track, own_tracks = _tracks_of_slots(time, slot, is_new, slots)
    result = Scans(instants[first], scan, values, own_track, tuple(own_tracks), duplicates)
    return result if entry.copies_within_m is None else _without_copies(result, time, model, entry.copies_within_m)


def _tracks_of_slots(time: Array, slot: Indices, is_new: Mask, names: list[str]) -> tuple[Indices, list[str]]:
    """Return the index of the sensor's own track of each row, and the names of the tracks: slot and number.

    A slot begins a new track where a row says so, or after it was empty for longer than ``EMPTY_SLOT`` s.
    """
    by_slot = np.argsort(slot, kind="stable")
    first = np.diff(slot[by_slot], prepend=-1) != 0
    is_beginning = first | is_new[by_slot] | (np.diff(time[by_slot], prepend=-np.inf) > EMPTY_SLOT)
    result = np.empty(len(time), dtype=np.intp)
    result[by_slot] = np.cumsum(is_beginning) - 1
    slots = slot[by_slot][is_beginning]
    count = np.arange(len(slots)) - np.searchsorted(slots, slots)
    return result, [f"{names[s]}-{number + 1}" for s, number in zip(slots.tolist(), count.tolist(), strict=True)]


def _without_copies(scans: Scans, time: Array, model: type[Sensor], within: float) -> Scans:
    """Leave out each detection nearer than ``within`` m to a detection of an older track in the same scan."""
    position = position_of(model.components, scans.measurement)
    _, first_row, track = np.unique(scans.own_track, return_index=True, return_inverse=True)
    began = time[first_row][track]
    order = np.lexsort((began, scans.scan))
    kept = np.ones(len(time), dtype=bool)
    for rows_of_scan in np.split(order, np.flatnonzero(np.diff(scans.scan[order])) + 1):
        older: list[int] = []
        for row in rows_of_scan.tolist():
            offset = position[:, older] - position[:, [row]]
            kept[row] = not np.any(np.hypot(*offset) < within)
            older += [row] if kept[row] else []
    scan, measurement, own_track = scans.scan[kept], scans.measurement[:, kept], scans.own_track[kept]
    return scans._replace(scan=scan, measurement=measurement, own_track=own_track, copies=int((~kept).sum()))


def recorded_detections(scans: Scans, times: Array) -> RecordedDetections:
    """Return the detections of the scans whose times are among ``times``, the truth's."""
    is_kept = np.isin(scans.time, times)
    number = np.cumsum(is_kept) - 1
    is_row_kept = is_kept[scans.scan]
    return RecordedDetections(
        np.searchsorted(times, scans.time[is_kept]),
        number[scans.scan[is_row_kept]],
        scans.measurement[:, is_row_kept],
        scans.own_track[is_row_kept],
        scans.own_tracks,
    )

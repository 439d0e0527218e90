"""The measurements of a sensor's table, and the scans that unlabelled ones make."""

from __future__ import annotations

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Mask, RecordedDetections
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth.config.columns import POLAR, MeasurementColumns, Units
from trackbench.truth.recorded.cycles import MOST_MISSED, cycles
from trackbench.truth.recorded.drive import Scans, row_order
from trackbench.truth.recorded.rows import Rows

#: A slot that was empty for longer has another object afterwards, s.
EMPTY_SLOT = 1.0
#: Cycles without a row for each with one, at most, where rows have no slots: rows of one scan that are some ms apart
#: would be taken for many scans.
FEW_MISSED = 0.5


def column_measurements(
    table: Rows, entry: MeasurementColumns, units: Units, sensor: type[Sensor]
) -> tuple[Array, Indices]:
    """The measurements ``(m, n)`` in SI units and radians, and the rows ``(n,)`` that have one.

    Raises:
        InputError: a number is damaged, or no row has a measurement.
    """
    named, quantities = entry.components, entry.quantities(sensor.components, sensor.units)
    values = []
    for name, quantity in quantities.items():
        factor = units.factor(quantity, entry.units.get(name))
        bias = entry.bias.get(name, 0.0) * factor
        values.append(table.numbers(named[name], factor, quantity, optional=True) - bias)
    there = np.isfinite(values)
    for row in np.flatnonzero(there.any(axis=0) & ~there.all(axis=0)).tolist():
        missing = named[list(quantities)[int(np.argmin(there[:, row]))]]
        raise table.error(row, f"{missing} is empty, but other columns of the same measurement are not")
    rows = np.flatnonzero(there.all(axis=0))
    if not len(rows):
        raise InputError(f"there is no measurement in {', '.join(named.values())}", file=table.file)
    measurement = np.stack(values)[:, rows]
    if tuple(quantities) != sensor.components:
        x, y = measurement[:2]
        measurement = np.stack([np.hypot(x, y), np.arctan2(y, x), *measurement[2:]])
    return measurement, rows


def position_of(components: tuple[str, ...], measurement: Array) -> Array:
    """Return the position ``(2, n)`` that measurements ``(m, n)`` state, in the sensor's frame, m."""
    first, second = measurement[:2]
    is_polar = components[:2] == POLAR
    return np.stack([first * np.cos(second), first * np.sin(second)] if is_polar else [first, second])


def columns_of(entry: MeasurementColumns) -> list[str | None]:
    """The columns of a file of unlabelled measurements, as far as they are given."""
    return [entry.time, entry.slot, entry.new_track, *entry.components.values()]


def scans_of(table: Rows, entry: MeasurementColumns, at: Array, units: Units, kind: str) -> Scans:
    """The scans of unlabelled measurements.

    Args:
        table: of one sensor.
        entry: what its columns are called.
        at: ``(rows,)`` times, s.
        units: of the columns.
        kind: of the sensor.

    Raises:
        InputError: a row is damaged.
    """
    model = SENSOR_MODELS[kind]
    measurement, detected = column_measurements(table, entry, units, model)
    there = np.zeros(len(table), dtype=bool)
    there[detected] = True
    measured, at_rows = (table, at) if there.all() else (table.only(there), at[there])
    new = np.zeros(len(measured), dtype=bool)
    if entry.new_track is not None:
        flags = measured.numbers(entry.new_track, 1.0, None)
        for row in np.flatnonzero((flags != 0) & (flags != 1)).tolist():
            raise measured.error(row, f"{entry.new_track} is {flags[row]:g}, where 0 or 1 is expected")
        new = flags == 1
    if entry.slot is None:
        # Two equal rows are two detections.
        slots, slot = [""], np.zeros(len(measured), dtype=np.intp)
        kept, duplicates = np.argsort(at_rows, kind="stable"), 0
    else:
        slots, slot = measured.labels(entry.slot)
        kept, order = row_order(at_rows, slot)
        duplicates = order.duplicates
    time, slot, new = at_rows[kept], slot[kept], new[kept]
    looked = cycles(time, slot, np.unique(at), MOST_MISSED if entry.slot else FEW_MISSED)
    _, first, of_instant = np.unique(looked.cycle, return_index=True, return_inverse=True)
    instants = looked.instants
    scan = of_instant[np.searchsorted(instants, time)]
    values = measurement[:, kept]
    for i in model.angular:
        values[i] = wrap_angle(values[i])
    own_track, own_tracks = np.full(len(time), -1), list[str]()
    if entry.slot is not None:
        own_track, own_tracks = _tracks_of_slots(time, slot, new, slots)
    result = Scans(instants[first], scan, values, own_track, tuple(own_tracks), duplicates)
    return result if entry.copies_within_m is None else _without_copies(result, time, model, entry.copies_within_m)


def _tracks_of_slots(time: Array, slot: Indices, new: Mask, names: list[str]) -> tuple[Indices, list[str]]:
    """The number of the sensor's own track of each row, and their names: the slot and how many it had before.

    A slot has another track from a row on that says so, and where it was empty for longer than ``EMPTY_SLOT``.
    """
    by_slot = np.argsort(slot, kind="stable")
    first = np.diff(slot[by_slot], prepend=-1) != 0
    begins = first | new[by_slot] | (np.diff(time[by_slot], prepend=-np.inf) > EMPTY_SLOT)
    result = np.empty(len(time), dtype=np.intp)
    result[by_slot] = np.cumsum(begins) - 1
    slots = slot[by_slot][begins]
    count = np.arange(len(slots)) - np.searchsorted(slots, slots)
    return result, [f"{names[s]}-{number + 1}" for s, number in zip(slots.tolist(), count.tolist(), strict=True)]


def _without_copies(of: Scans, time: Array, model: type[Sensor], within: float) -> Scans:
    """Of detections of one scan that are near each other, only that of the sensor's older track."""
    position = position_of(model.components, of.measurement)
    _, first_row, track = np.unique(of.own_track, return_index=True, return_inverse=True)
    began = time[first_row][track]
    order = np.lexsort((began, of.scan))
    kept = np.ones(len(time), dtype=bool)
    for rows_of_scan in np.split(order, np.flatnonzero(np.diff(of.scan[order])) + 1):
        older: list[int] = []
        for row in rows_of_scan.tolist():
            away = position[:, older] - position[:, [row]]
            kept[row] = not np.any(np.hypot(*away) < within)
            older += [row] if kept[row] else []
    return of._replace(
        scan=of.scan[kept], measurement=of.measurement[:, kept], own_track=of.own_track[kept], copies=int((~kept).sum())
    )


def recorded_detections(of: Scans, times: Array) -> RecordedDetections:
    """The detections of the scans at some times, which are those of the truth."""
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

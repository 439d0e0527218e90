"""Whether stored tables are those of a run: their columns, the names in them, and rows at the same times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, nearest, shortened
from trackbench.results.columns import split
from trackbench.results.declared import HIDDEN, LABELLED

if TYPE_CHECKING:
    import pyarrow as pa

#: In the place of an object's name, where a detection stems from none, and where there is none.
FALSE_ALARM, NO_OBJECT = "false alarm", ""
#: The types that a column of numbers may have; what has no value in any row has no type either.
NUMBERS = {"number": ("floating",), "whole": ("floating", "integer", "boolean"), "sparse": ("floating", "null")}
OBSERVER = "observer"
#: The nanoseconds of a recording end at 9.2e9 s.
LATEST_S = 1e9
Names = Mapping[str, Collection[str]]


class TableLayout(NamedTuple):
    """What the tables of a run hold."""

    names: Names
    """What the columns of names may hold, by column."""
    objects: Sequence[str] = ()
    """Of the recorded run."""
    hidden: bool = False
    """Whether identities are hidden."""
    repeated: bool = False
    """Whether a time has a row for each measurement at it."""


def require_table(name: str, table: pa.Table, layout: TableLayout, file: Path) -> None:
    """Make sure that a table is one of a run.

    Args:
        name: of the table; one that is not known may hold anything.
        table: what was read.
        layout: of the run's tables.
        file: for error messages.

    Raises:
        InputError: it is not.
    """
    from pyarrow import types

    # What no tracker left has no columns either.
    declared = (HIDDEN if layout.hidden else LABELLED).get(name)
    if declared is None or not (len(table) or table.num_columns):
        return
    names = layout.names
    kinds = {column.name: column.kind for column in declared.columns}
    texts = tuple(column for column, kind in kinds.items() if kind == "name" and column in table.column_names)
    for column, _, _, _, required in declared.columns:
        count = table.column_names.count(column)
        if count > 1 or (required and not count):
            raise InputError(f"no column {column}, or several: not the table {name} of a run", file=file)
    for field in table.schema:
        type = field.type.value_type if types.is_dictionary(field.type) else field.type
        kind = kinds.get(field.name, "number")
        fitting = ("string",) if kind == "name" else NUMBERS[kind]
        if not any(getattr(types, f"is_{name_of_type}")(type) for name_of_type in fitting):
            raise InputError(f"{field.name} is a column of {type}: not the table {name} of a run", file=file)
    for column in texts:
        for value in table[column].unique().to_pylist():
            if value is None or value not in names.get(column, (value,)):
                hint = nearest(str(value), names.get(column, ()))
                raise InputError(f"{column} {shortened(str(value), 40)!r} is none of this run; {hint}", file=file)
    if declared.series:
        _require_times(name, table, texts, layout.repeated, file)
    if name == "runs":
        _require_runs(table, file)
    if name == "truth":
        _require_objects(table, layout.objects, file)


def _require_runs(table: pa.Table, file: Path) -> None:
    """Each tracker has each run once."""
    names, runs = table["tracker"].to_numpy(), table["run"].to_numpy()
    for tracker in np.unique(names):
        own = np.sort(runs[names == tracker])
        if not np.array_equal(own, np.arange(len(own))):
            raise InputError(f"{tracker} has not each run once: not the table runs of a run", file=file)


def _require_objects(table: pa.Table, objects: Sequence[str], file: Path) -> None:
    """The truth has each object of the run and what carries the sensors."""
    there = set(split(table, "role", "object"))
    for key in [*(("target", name) for name in objects), (OBSERVER, OBSERVER)]:
        if key not in there:
            raise InputError(f"{key[1]} is missing: not the table truth of this run", file=file)


def _require_times(name: str, table: pa.Table, texts: tuple[str, ...], repeated: bool, file: Path) -> None:
    """The series of one sensor have the same times, each once; so have all series of what is of no sensor.

    A time comes again where each of the measurements at it is scored.
    """
    if table["time_s"].null_count or not (np.abs(table["time_s"].to_numpy()) < LATEST_S).all():
        raise InputError(f"time_s is not finite, or beyond {LATEST_S:g} s: not the table {name} of a run", file=file)
    by_sensor: dict[str, np.ndarray] = {}
    later = np.greater_equal if repeated else np.greater
    for key, rows in split(table, *texts).items():
        sensor = key[texts.index("sensor")] if "sensor" in texts else ""
        times = by_sensor.setdefault(sensor, rows["time_s"])
        if not np.array_equal(times, rows["time_s"]) or not later(times[1:], times[:-1]).all():
            message = f"{' '.join(key)} has not each time of the others once: not the table {name} of a run"
            raise InputError(message, file=file)

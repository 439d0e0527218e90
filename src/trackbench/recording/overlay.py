"""Several runs of the same traffic as one: each one's trackers in the one scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from trackbench.recording.tables import split
from trackbench.results import Result


def labels(paths: Sequence[Path]) -> list[str]:
    """A short name for each of several runs: the part of their paths that tells them apart."""
    parts = [path.resolve().with_suffix("").parts for path in paths]
    for i in range(1, min(map(len, parts)) + 1):
        names = [part[-i] for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{path} ({number})" for number, path in enumerate(paths, start=1)]


def same_traffic(results: Sequence[Result]) -> bool:
    """Whether all show the same motion of the same objects."""
    first, *others = (split(result.tables["truth"], "role", "object") for result in results)
    return all(
        other.keys() == first.keys()
        and all(_equal(other[key][name], rows[name]) for key, rows in first.items() for name in ("px_m", "py_m"))
        for other in others
    )


def laid_over(named: dict[str, Result]) -> Result:
    """Runs of the same traffic as one result to be drawn; a tracker is called "its name (its run's name)"."""
    first = next(iter(named.values()))
    same_measurements = all(_same_measurements(first, result) for result in named.values())
    summaries = {label: result.json() for label, result in named.items()}
    trackers = [
        {**tracker, "name": _named(tracker["name"], label)}
        for label, summary in summaries.items()
        for tracker in summary["trackers"]
    ]
    sensors = {
        name if same_measurements else _named(name, label): sensor
        for label, summary in summaries.items()
        for name, sensor in summary["sensors"].items()
    }
    summary = {
        **first.json(),
        "scenario": {**first.json()["scenario"], "name": " over ".join(named)},
        "runs": first.summary.runs,
        "command": "; ".join(str(summary["command"]) for summary in summaries.values()),
        "sensors": sensors,
        "trackers": trackers,
        "ranking": [tracker["name"] for tracker in sorted(trackers, key=_error)],
        "expectations": [],
        "passed": True,
    }
    tables = dict(first.tables)
    for table, column in (
        ("steps", "tracker"),
        ("nis", "tracker"),
        ("estimates", "tracker"),
        ("recorded_nis", "tracker"),
    ):
        tables[table] = _joined({label: result.tables[table] for label, result in named.items()}, column)
    if not same_measurements:
        tables["measurements"] = _joined(
            {label: result.tables["measurements"] for label, result in named.items()}, "sensor"
        )
    return Result.from_json(summary, tables)


def _named(name: str, label: str) -> str:
    return f"{name} ({label})"


def _error(tracker: dict[str, Any]) -> float:
    value = None if tracker["failed"] else tracker["metrics"]["position_rmse"]["value"]
    return float("inf") if value is None else float(value)


def _joined(tables: Mapping[str, pa.Table], column: str) -> pa.Table:
    """The rows of all tables, with their label after the name in a column."""
    parts = []
    for label, table in tables.items():
        if table.num_rows:
            names = pa.array([_named(str(name), label) for name in table.column(column).to_pylist()])
            plain = table.set_column(table.schema.get_field_index(column), column, names)
            parts.append({name: _undictionaried(plain[name]) for name in sorted(plain.column_names)})
    return pa.concat_tables([pa.table(part) for part in parts]) if parts else pa.table({})


def _undictionaried(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column


def _same_measurements(a: Result, b: Result) -> bool:
    first, second = (split(result.tables["measurements"], "sensor", "object") for result in (a, b))
    return first.keys() == second.keys() and all(
        _equal(first[key][name], second[key][name]) for key in first for name in ("time_s", "x_m", "y_m")
    )


def _equal(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b, equal_nan=True))

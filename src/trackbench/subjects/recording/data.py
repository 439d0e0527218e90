"""The numbers of a run inside its recording, in full precision, so that it can be read back without the viewer.

What is drawn is rounded to single precision. Below ``data`` each table of the run is kept as it is: one entity for each
tracker, object and sensor, one component for each column. The summary is a text.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr

from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.subjects.recording.chunks import EntityRows
from trackbench.subjects.recording.scene import ROADS
from trackbench.subjects.recording.stream import TIMELINE, Stream, path

DATA = "data"
SUMMARY = (DATA, "result")
#: The tables that are kept, each with the columns whose values tell its entities apart.
KEYS: dict[str, tuple[str, ...]] = {
    "truth": ("role", "object"),
    "measurements": ("sensor", "kind", "object"),
    "estimates": ("tracker", "object"),
    "recorded_nis": ("tracker", "sensor", "object"),
    "steps": ("tracker",),
    "nis": ("tracker", "sensor"),
    "modes": ("tracker", "mode"),
    "recorded_modes": ("tracker", "mode", "object"),
}
#: The same where identities are hidden, and the tables that are kept as one text each.
HIDDEN_KEYS = {
    "truth": KEYS["truth"],
    "measurements": KEYS["measurements"],
    "tracks": ("tracker",),
    "taken": ("tracker",),
    "due": ("object",),
    "steps": ("tracker",),
}
HIDDEN_TEXTS = ("events", "objects", "association", "existence")
#: Static components: which table and which of its groups of rows an entity holds; the keys are named like columns.
TABLE, GROUP = "table", "group"


def send_data(stream: Stream, result: Result) -> None:
    """The summary and the tables."""
    stream.static(path(*SUMMARY), rr.TextDocument(json.dumps(result.json(), allow_nan=False, ensure_ascii=False)))
    hidden = result.summary.identities == "hidden"
    for table in HIDDEN_TEXTS if hidden else ():
        rows = result.tables[table]
        if table == "events" and rows.num_rows:
            rows = rows.filter(pc.equal(rows["run"], float(result.summary.recorded_run)))
        stream.static(path(DATA, table), rr.TextDocument(json.dumps(rows.to_pydict(), ensure_ascii=False)))
    for table, keys in (HIDDEN_KEYS if hidden else KEYS).items():
        for group, (values, rows) in enumerate(split(result.tables.if_there(table), *keys).items()):
            entity = path(DATA, table, *values)
            about: dict[str, Any] = {TABLE: table, GROUP: group, **dict(zip(keys, values, strict=True))}
            stream.static(entity, rr.AnyValues(**about))
            # Rerun keeps the type that a component had first: all numbers are of one type.
            numbers: dict[str, Any] = {
                name: column if column.dtype == bool else column.astype(float)
                for name, column in rows.items()
                if name not in keys
            }
            stream.columns(entity, rows["time_s"], rr.AnyValues.columns(**numbers))


def read_data(chunks: Iterable[EntityRows]) -> tuple[dict[str, Any] | None, dict[str, pa.Table]]:
    """The summary as JSON values, None where there is none, and the tables out of a recording's chunks.

    Rows come sorted by key and time; a table that had no rows has no columns either.
    """
    summary, roads = None, _roads([])
    kept: dict[str, pa.Table] = {}
    text_tables = {path(DATA, table): table for table in HIDDEN_TEXTS}
    static: dict[str, dict[str, Any]] = {}
    parts: dict[str, list[pa.RecordBatch]] = {}
    for chunk in chunks:
        entity = chunk.entity
        if entity == path(*SUMMARY):
            (texts,) = chunk.rows.column("TextDocument:text").to_pylist()
            summary = json.loads(texts[0])
        elif entity == path(*ROADS):
            roads = _roads(chunk.rows.column("LineStrips2D:strips").to_pylist()[0])
        elif entity in text_tables:
            (content,) = chunk.rows.column("TextDocument:text").to_pylist()
            kept[text_tables[entity]] = _text_table(json.loads(content[0]))
        elif not entity.startswith(path(DATA) + "/"):
            continue
        elif chunk.static:
            (values,) = chunk.rows.to_pylist()
            known = static.setdefault(entity, {})
            known.update((name, value[0]) for name, value in values.items() if isinstance(value, list))
        else:
            parts.setdefault(entity, []).append(chunk.rows)
    groups: dict[str, dict[int, dict[str, npt.NDArray[Any]]]] = {}
    for entity, batches in parts.items():
        keys = static[entity]
        table, group = str(keys.pop(TABLE)), int(keys.pop(GROUP))
        groups.setdefault(table, {})[group] = _rows(keys, batches)
    tables = HIDDEN_KEYS if kept else KEYS
    return summary, {"roads": roads, **kept, **{table: _table(groups.get(table, {})) for table in tables}}


def _text_table(columns: dict[str, list[Any]]) -> pa.Table:
    """A table kept as text: columns of texts, and of numbers that may be null."""
    if not any(columns.values()):
        return pa.table({})
    texts = {name for name, values in columns.items() if any(isinstance(value, str) for value in values)}
    return pa.table(
        {name: pa.array(values, pa.string() if name in texts else pa.float64()) for name, values in columns.items()}
    )


def _roads(strips: list[list[list[float]]]) -> pa.Table:
    """The lane edges, which are kept as they are drawn."""
    points = [(float(line), *point) for line, strip in enumerate(strips or []) for point in strip]
    rows = np.array(points, dtype=float).reshape(-1, 3)
    return pa.table(dict(zip(("line", "x_m", "y_m"), rows.T, strict=True)))


def _rows(keys: dict[str, str], batches: list[pa.RecordBatch]) -> dict[str, npt.NDArray[Any]]:
    """The columns of one entity, the keys in front, sorted by time."""
    table = pa.Table.from_batches(batches)
    names = [field.name for field in table.schema if pa.types.is_list(field.type) and field.name != TIMELINE]
    numbers = {name: table.column(name).combine_chunks().flatten().to_numpy(zero_copy_only=False) for name in names}
    order = np.argsort(numbers["time_s"], kind="stable")
    texts = {name: np.full(len(order), value, dtype=object) for name, value in keys.items()}
    return {**texts, **{name: values[order] for name, values in numbers.items()}}


def _table(groups: dict[int, dict[str, npt.NDArray[Any]]]) -> pa.Table:
    """The rows of all entities of one table, in their first order."""
    if not groups:
        return pa.table({})
    ordered = [groups[number] for number in sorted(groups)]
    return pa.table(
        {name: pa.array(np.concatenate([rows[name] for rows in ordered]), from_pandas=True) for name in ordered[0]}
    )

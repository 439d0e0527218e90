"""The values of a result, by their paths, for `same_numbers`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

#: A number, a word or null of a JSON file; a column of a table; the names of the entries of a list, in order.
Values = dict[str, Any]
ORDER = "<order>"
#: What tells the entries of a list apart, the first of these that does.
NAMED_BY = (
    ("name",),
    ("key",),
    ("option",),
    ("scenario", "entrant", "metric"),
    ("scenario", "a", "b", "metric"),
    ("a", "b", "metric"),
    ("scenario", "metric"),
    ("text",),
    ("fault", "sensor"),
)


def read(folder: Path, name: str) -> Values:
    """Everything in the JSON files and Parquet tables under ``folder``.

    A file in the run's own folder goes by its name alone; those of ``commands/...`` have that name before them.
    """
    values: Values = {}
    for file in sorted(folder.rglob("*")):
        path = file.relative_to(folder)
        shown = f"{name}/{path}" if name.startswith("commands/") else str(Path(*path.parts[1:]))
        if file.suffix == ".json":
            values.update(_flat(json.loads(file.read_text(encoding="utf-8")), f"{shown}:"))
        elif file.suffix == ".parquet":
            table = pyarrow.parquet.read_table(file)
            values[f"{shown}:<rows>"] = table.num_rows
            values.update({f"{shown}:{column}": _array(table.column(column)) for column in table.column_names})
    return values


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{path}{key}" if path.endswith(":") else f"{path}.{key}")
        if not value:
            yield path, "{}"
    elif isinstance(value, list):
        names = _names(value)
        yield f"{path}{ORDER}", names
        for name, item in zip(names, value, strict=True):
            yield from _flat(item, f"{path}[{name}]")
    else:
        yield path, value


def _names(entries: list[Any]) -> list[str]:
    for keys in NAMED_BY:
        if all(isinstance(entry, dict) and entry.keys() >= set(keys) for entry in entries):
            names = ["|".join(_word(entry[key]) for key in keys) for entry in entries]
            if len(set(names)) == len(names):
                return names
    return [str(number) for number in range(len(entries))]


def _word(value: Any) -> str:
    return "/".join(_word(item) for item in value.values()) if isinstance(value, dict) else str(value)


def _array(column: pa.ChunkedArray) -> Any:
    """Words as a list, with None; numbers as an array of their bits' type, with the nulls beside them."""
    kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind)):
        return column.to_pylist()
    array = column.cast(kind).combine_chunks()
    filled = array.fill_null(False if pa.types.is_boolean(kind) else 0).to_numpy(zero_copy_only=False)
    return np.ma.array(filled, mask=array.is_null().to_numpy(zero_copy_only=False))


def same_bits(old: Any, new: Any) -> bool:
    """Whether two values or columns are of one type and the same to the last bit; NaN is NaN."""
    if isinstance(old, np.ma.MaskedArray) and isinstance(new, np.ma.MaskedArray):
        return old.dtype == new.dtype and old.shape == new.shape and not _unlike(old, new).any()
    if type(old) is not type(new):
        return False
    return old.hex() == new.hex() if isinstance(old, float) else bool(old == new)


def _unlike(old: np.ma.MaskedArray, new: np.ma.MaskedArray) -> Any:
    """Which rows differ, of two columns of one type and length."""
    a, b = old.filled(0), new.filled(0)
    differ = np.ma.getmaskarray(old) != np.ma.getmaskarray(new)
    if a.dtype.kind != "f":
        return differ | (a != b)
    bits = f"u{a.dtype.itemsize}"
    return differ | ((a.view(bits) != b.view(bits)) & ~(np.isnan(a) & np.isnan(b)))


def describe_difference(old: Any, new: Any) -> str:
    """Where two values or columns that are not the same differ first."""
    columns = [isinstance(side, np.ma.MaskedArray | list) for side in (old, new)]
    if not all(columns):
        return f": {'a column' if columns[0] else repr(old)} -> {'a column' if columns[1] else repr(new)}"
    if isinstance(old, list) != isinstance(new, list) or getattr(old, "dtype", 0) != getattr(new, "dtype", 0):
        return f": {getattr(old, 'dtype', 'words')} -> {getattr(new, 'dtype', 'words')}"
    if len(old) != len(new):
        return f": {len(old)} -> {len(new)} rows"
    if isinstance(old, list):
        rows = [row for row, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    else:
        rows = np.flatnonzero(_unlike(old, new)).tolist()
    a, b = ("null" if side[rows[0]] is np.ma.masked else repr(side[rows[0]]) for side in (old, new))
    return f"[{rows[0]}]: {a} -> {b} ({len(rows)} of {len(old)} rows)"


def numerals(text: Any) -> list[str]:
    """The numbers in a sentence, or in each of several."""
    return re.findall(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?", json.dumps(text))

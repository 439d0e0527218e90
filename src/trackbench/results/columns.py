"""Conversion of a result's tables: made from records of columns, read and split as NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Mask

if TYPE_CHECKING:
    import pyarrow as pa

#: Columns by name; null floats are NaN.
Columns = dict[str, npt.NDArray[Any]]
#: Columns of some rows by name: an array ``(rows,)``, a list of words, or a single value for all rows.
Record = Mapping[str, Any]


def table_of(records: Sequence[Record]) -> pa.Table:
    """Return a table with the rows of all records, each a mapping from column to values; columns as in the first."""
    import pyarrow as pa

    sizes = [next((len(value) for value in part.values() if not isinstance(value, str | float)), 1) for part in records]
    columns: dict[str, pa.Array] = {}
    for name, first in records[0].items() if records else ():
        values = [(part[name], size) for part, size in zip(records, sizes, strict=True)]
        if all(isinstance(value, str) for value, _ in values):
            filled = [value for value in values if value[1]]
            columns[name] = _words([word for word, _ in filled], [size for _, size in filled])
        elif isinstance(first, str | list):
            texts = [text for value, size in values for text in ([value] * size if isinstance(value, str) else value)]
            columns[name] = _words(texts)
        else:
            arrays = [value if np.shape(value) == (size,) else np.full(size, value) for value, size in values]
            numbers = np.concatenate(arrays)
            columns[name] = _numbers(numbers, numbers == numbers)
    return pa.table(columns)


# Arrow's own conversion imports pandas wherever that is installed, which takes a quarter of a second.
def _numbers(values: npt.NDArray[Any], known: Mask) -> pa.Array:
    import pyarrow as pa

    data = np.packbits(values, bitorder="little") if values.dtype == bool else values
    nulls = None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little"))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [nulls, pa.py_buffer(data)])


def _words(texts: Sequence[str | None], repeats: int | Sequence[int] = 1) -> pa.Array:
    import pyarrow as pa

    once = [text for text in dict.fromkeys(texts) if text is not None]
    place: dict[str | None, int] = {text: number for number, text in enumerate(once)}
    encoded = [text.encode() for text in once]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    words = pa.StringArray.from_buffers(len(once), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))
    indices = np.repeat(np.array([place.get(text, -1) for text in texts], dtype=np.int32), repeats)
    return pa.DictionaryArray.from_arrays(_numbers(indices, indices >= 0), words)


def mean(total: Array, count: Array) -> Array:
    """Return ``total / count``, NaN where the count is zero."""
    return total / np.where(count > 0, count, np.nan)


def table_columns(table: pa.Table) -> Columns:
    """Return all columns of a table as NumPy arrays, by name."""
    return {name: table.column(name).to_numpy() for name in table.column_names}


def split(table: pa.Table, *keys: str) -> dict[tuple[str, ...], Columns]:
    """Split a table by the values of ``keys``, in order of appearance; rows are sorted by ``time_s``.

    A table without rows is allowed to lack the columns.
    """
    if not table.num_rows:
        return {}
    rows = table_columns(table)
    time = rows["time_s"]
    code = np.zeros(len(time), dtype=np.int64)
    for key in keys:
        encoded = table.column(key).combine_chunks().dictionary_encode()
        code = code * len(encoded.dictionary) + encoded.indices.to_numpy()
    _, first, group = np.unique(code, return_index=True, return_inverse=True)
    order = np.lexsort((time, first[group]))
    starts = np.flatnonzero(np.diff(first[group][order], prepend=-1))
    return {
        tuple(str(rows[key][part[0]]) for key in keys): {name: values[part] for name, values in rows.items()}
        for part in np.split(order, starts[1:])
        if len(part)
    }


def mean_over_objects(time: npt.NDArray[Any], values: npt.NDArray[Any]) -> tuple[Any, Any, Any]:
    """Return the instants with a finite value, the mean of the finite values at each instant, and their number."""
    finite = np.isfinite(values)
    instants, index, count = np.unique(time[finite], return_inverse=True, return_counts=True)
    return instants, np.bincount(index, weights=values[finite], minlength=len(instants)) / count, count

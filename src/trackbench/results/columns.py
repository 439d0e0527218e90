"""Arrow tables as NumPy columns, and the rows of one vehicle or tracker out of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

#: Columns by name; null floats are NaN.
Columns = dict[str, npt.NDArray[Any]]


def columns(table: pa.Table) -> Columns:
    """All columns of a table."""
    return {name: table.column(name).to_numpy() for name in table.column_names}


def split(table: pa.Table, *keys: str) -> dict[tuple[str, ...], Columns]:
    """The rows of each combination of ``keys``, each sorted by ``time_s``; combinations in order of appearance.

    A table without rows may lack its columns too.
    """
    if not table.num_rows:
        return {}
    rows = columns(table)
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
    """The instants at which any value is finite, the mean of the finite values at each, and how many there are."""
    finite = np.isfinite(values)
    instants, index, count = np.unique(time[finite], return_inverse=True, return_counts=True)
    return instants, np.bincount(index, weights=values[finite], minlength=len(instants)) / count, count

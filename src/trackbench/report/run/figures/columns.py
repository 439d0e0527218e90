"""Rows and columns of a result's tables, as arrays. A table is empty where every tracker failed."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.types import Array


def where(table: pa.Table, **keys: str) -> pa.Table:
    """The rows of ``table`` whose columns equal ``keys``."""
    for name, value in keys.items():
        if name in table.column_names:
            table = table.filter(pc.equal(table[name], value))
    return table


def column(table: pa.Table, name: str) -> Array:
    """A column as floats, NaN where it is null; nothing where the table lacks it."""
    if name not in table.column_names:
        return np.empty(0)
    values: Array = table[name].to_numpy().astype(np.float64)
    return values


def names(table: pa.Table, name: str) -> list[str]:
    """The different values of a column of text, in the order in which they come."""
    return [] if name not in table.column_names else table[name].unique().to_pylist()

"""A table of a result: its columns, what they are made from, and its rows as NumPy arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array

if TYPE_CHECKING:
    import pyarrow as pa

#: Columns by name; null floats are NaN.
Columns = dict[str, npt.NDArray[Any]]
#: What some rows are made from, by name: arrays and lists ``(rows,)``, or single values for all of them.
Record = Mapping[str, Any]


class TableColumn(NamedTuple):
    """A column of a table."""

    name: str
    unit: str
    """As it stands after a number: "1" where there is none, empty of names and of what has the sensor's units."""
    source: str | Callable[[Record], Any]
    """The entry of a record that it is, or what computes it from a record."""
    is_name: bool = False
    """Whether it holds words, which tell series apart."""

    def values(self, record: Record) -> Any:
        """``(rows,)``, or a single value for all rows."""
        return record[self.source] if isinstance(self.source, str) else self.source(record)


class DeclaredTable(NamedTuple):
    """What a table holds."""

    meaning: str
    columns: list[TableColumn]

    def written(self, records: Sequence[Record], more: Iterable[str] = ()) -> pa.Table:
        """The table of these records; without columns where there are none, and without those whose entry is missing.

        Args:
            records: each of some rows.
            more: names of entries that are columns of this result alone.
        """
        import pyarrow as pa

        if not records:
            return pa.table({})
        columns = [
            column for column in self.columns if not isinstance(column.source, str) or column.source in records[0]
        ]
        columns += [TableColumn(name, "1", name) for name in more]
        parts = [{column.name: column.values(record) for column in columns} for record in records]
        sizes = [next((len(each) for each in part.values() if not isinstance(each, str | float)), 1) for part in parts]
        stacked: dict[str, pa.Array] = {}
        for column in columns:
            values = [(part[column.name], size) for part, size in zip(parts, sizes, strict=True)]
            if column.is_name:
                texts = [text for each, size in values for text in ([each] * size if isinstance(each, str) else each)]
                stacked[column.name] = pa.array(texts, pa.string()).dictionary_encode()
            else:
                arrays = [np.broadcast_to(each, size) for each, size in values]
                stacked[column.name] = pa.array(np.concatenate(arrays), from_pandas=True)
        return pa.table(stacked)


def mean(total: Array, count: Array) -> Array:
    """NaN where the count is zero."""
    return total / np.where(count > 0, count, np.nan)


def table_columns(table: pa.Table) -> Columns:
    """All columns of a table."""
    return {name: table.column(name).to_numpy() for name in table.column_names}


def split(table: pa.Table, *keys: str) -> dict[tuple[str, ...], Columns]:
    """The rows of each combination of ``keys``, each sorted by ``time_s``; combinations in order of appearance.

    A table without rows may lack its columns too.
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
    """The instants at which any value is finite, the mean of the finite values at each, and how many there are."""
    finite = np.isfinite(values)
    instants, index, count = np.unique(time[finite], return_inverse=True, return_counts=True)
    return instants, np.bincount(index, weights=values[finite], minlength=len(instants)) / count, count

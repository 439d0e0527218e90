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


#: What a column is made from: the entry of a record of this name, or what computes it from a record.
Source = str | Callable[[Record], Any]


class DeclaredTable(NamedTuple):
    """Columns of a table, those of words first."""

    names: tuple[str, ...]
    """Columns of words, which tell series apart: the entries of these names."""
    numbers: dict[str, Source]

    def values(self, name: str, record: Record) -> Any:
        """``(rows,)`` values of a column of numbers, or a single value for all rows."""
        source = self.numbers[name]
        return record[source] if isinstance(source, str) else source(record)

    def written(self, records: Sequence[Record], more: Iterable[str] = ()) -> pa.Table:
        """The table of these records; without columns where there are none, and without those whose entry is missing.

        Args:
            records: each of some rows.
            more: names of entries that are columns of this result alone.
        """
        import pyarrow as pa

        if not records:
            return pa.table({})
        numbers: dict[str, Source] = {**self.numbers, **{name: name for name in more}}
        there = {name: source for name, source in numbers.items() if callable(source) or source in records[0]}
        table = self._replace(names=tuple(name for name in self.names if name in records[0]), numbers=there)
        parts = [
            {name: record[name] for name in table.names} | {name: table.values(name, record) for name in there}
            for record in records
        ]
        sizes = [next((len(each) for each in part.values() if not isinstance(each, str | float)), 1) for part in parts]
        stacked: dict[str, pa.Array] = {}
        for name in parts[0]:
            values = [(part[name], size) for part, size in zip(parts, sizes, strict=True)]
            if name in table.names:
                texts = [text for each, size in values for text in ([each] * size if isinstance(each, str) else each)]
                stacked[name] = pa.array(texts, pa.string()).dictionary_encode()
            else:
                arrays = [np.broadcast_to(each, size) for each, size in values]
                stacked[name] = pa.array(np.concatenate(arrays), from_pandas=True)
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

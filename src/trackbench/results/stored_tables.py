"""Tables of a result, each read when it is first used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import InputError
from trackbench.results.checks import stored_table
from trackbench.results.folder import SUMMARY

if TYPE_CHECKING:
    import pyarrow as pa


class Tables(Mapping[str, Any]):
    """Tables of a result by name, each read from the folder of the run when it is first used.

    Each table is also an attribute, such as ``tables.steps``.
    """

    def __init__(self, tables: Mapping[str, pa.Table | str], folder: Path = Path()) -> None:
        """Take for each name the table itself, or the sha256 of the file in ``folder`` that holds the table."""
        self._tables, self._folder = dict(tables), folder

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)

    def __contains__(self, name: object) -> bool:
        return name in self._tables

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def __getattr__(self, name: str) -> pa.Table:
        """Return the table of this name as an attribute, such as ``tables.steps``."""
        if name.startswith("_") or name not in self:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self[name]

    def __getitem__(self, name: str) -> pa.Table:
        """Return the table of this name.

        Raises:
            InputError: its file is not in the folder or cannot be read.
        """
        table = self._tables[name]
        if isinstance(table, str):
            file = self._folder / f"{name}.parquet"
            try:
                table = self._tables[name] = stored_table(file, table, SUMMARY)
            except FileNotFoundError as error:
                raise InputError(f"no {file.name} in the folder of this run", file=file.parent) from error
        return table

    def if_there(self, name: str) -> pa.Table:
        """Return a table that some runs lack; an empty table without columns if it is missing."""
        import pyarrow as pa

        return self[name] if name in self else pa.table({})

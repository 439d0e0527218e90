"""The tables of a result, each read when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.results.declared import HIDDEN, LABELLED
from trackbench.results.folder import TableLayout, require_table

if TYPE_CHECKING:
    import pyarrow as pa


class Tables(Mapping[str, Any]):
    """The tables of a result by name, in memory or in its folder.

    A table is an attribute too, such as ``tables.steps``; ``results.declared`` says what each holds.
    """

    def __init__(
        self, loaded: Mapping[str, pa.Table], folder: Path | None = None, layout: TableLayout | None = None
    ) -> None:
        """``loaded``: those in memory. ``folder``: where the others are read from. ``layout``: of these."""
        self._loaded = dict(loaded)
        self._folder = folder
        self._layout = layout or TableLayout({})

    def __iter__(self) -> Iterator[str]:
        there = [] if self._folder is None else [file.stem for file in sorted(self._folder.glob("*.parquet"))]
        return iter(dict.fromkeys([*self._loaded, *there]))

    def __getattr__(self, name: str) -> pa.Table:
        """A table as an attribute."""
        if name not in LABELLED | HIDDEN:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(LABELLED | HIDDEN)]

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return any(name == there for there in self)

    def __getitem__(self, name: str) -> pa.Table:
        """A table by its name.

        Raises:
            InputError: it is not in the folder or cannot be read.
        """
        if name not in self._loaded:
            self._loaded[name] = self._read(name)
        return self._loaded[name]

    def if_there(self, name: str) -> pa.Table:
        """A table that not every run leaves; without rows where it is not there."""
        import pyarrow as pa

        return self[name] if name in self else pa.table({})

    def _read(self, name: str) -> pa.Table:
        if self._folder is None:
            raise KeyError(name)
        import pyarrow as pa
        import pyarrow.parquet as pq

        file = self._folder / f"{name}.parquet"
        try:
            require_regular(file)
            table = pq.read_table(file)
            require_table(name, table, self._layout, file)
            return table
        except FileNotFoundError as error:
            raise InputError(f"no {file.name} in the folder of this run", file=self._folder) from error
        except (OSError, ValueError, pa.ArrowException) as error:
            raise InputError(f"not a readable table: {' '.join(str(error).split())}", file=file) from error

"""The tables of a result, each read when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.results.table_check import TableLayout, require_table


class _Table:
    """A table as an attribute of :class:`Tables`."""

    def __init__(self, describes: str) -> None:
        self.__doc__ = describes

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, tables: Tables, owner: type) -> pa.Table:
        return tables[self.name]


class Tables(Mapping[str, pa.Table]):
    """The tables of a result by name, in memory or in its folder."""

    steps = _Table("errors of each tracker at each instant, over runs and objects")
    nis = _Table("normalised innovation squared of each tracker and sensor at each measurement")
    runs = _Table("errors of each tracker in each run")
    breakdown = _Table("errors of each tracker by manoeuvre and range band")
    autocorrelation = _Table("autocorrelation of each tracker's whitened innovations, by lag")
    truth = _Table("motion of every target and of the observer in the recorded run")
    measurements = _Table("every measurement of the recorded run")
    estimates = _Table("every tracker's estimates of the recorded run")
    recorded_nis = _Table("normalised innovation squared of every measurement of the recorded run")
    modes = _Table("if trackers have modes: their probability at each instant, mean over runs and objects")
    recorded_modes = _Table("if trackers have modes: their probability in the recorded run")
    roads = _Table("lane edges to draw")
    tracks = _Table("where identities are hidden: every confirmed track of the recorded run")
    taken = _Table("where identities are hidden: the detection that each track of the recorded run took in each scan")
    gates = _Table("where identities are hidden: outlines of the gates of built-in trackers in the recorded run")
    due = _Table("where identities are hidden: 0 absent, 1 optional, 2 due, of each object in the recorded run")
    events = _Table("where identities are hidden: what happened to objects and tracks")
    objects = _Table("where identities are hidden: what each object's time was spent on in the recorded run")
    association = _Table("where identities are hidden: how often tracks took a detection of their own object")
    existence = _Table("where identities are hidden: tracks by stated existence probability, and how many are real")

    def __init__(
        self, known: Mapping[str, pa.Table], folder: Path | None = None, layout: TableLayout | None = None
    ) -> None:
        """``known``: those in memory. ``folder``: where the others are read from. ``layout``: of these."""
        self._known = dict(known)
        self._folder = folder
        self._layout = layout or TableLayout({})

    def __iter__(self) -> Iterator[str]:
        there = [] if self._folder is None else [file.stem for file in sorted(self._folder.glob("*.parquet"))]
        return iter(dict.fromkeys([*self._known, *there]))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return any(name == known for known in self)

    def __getitem__(self, name: str) -> pa.Table:
        """A table by its name.

        Raises:
            InputError: it is not in the folder or cannot be read.
        """
        if name not in self._known:
            self._known[name] = self._read(name)
        return self._known[name]

    def if_there(self, name: str) -> pa.Table:
        """A table that not every run leaves; without rows where it is not there."""
        return self[name] if name in self else pa.table({})

    def _read(self, name: str) -> pa.Table:
        if self._folder is None:
            raise KeyError(name)
        file = self._folder / f"{name}.parquet"
        try:
            require_regular(file)
            table = pq.read_table(file)
            require_table(name, table, self._layout, file)
            return table
        except FileNotFoundError as error:
            raise InputError(f"no {file.name} in the folder of this run", file=self._folder) from error
        except (OSError, ValueError, pa.ArrowException) as error:
            raise InputError(f"not a readable table: {error}", file=file) from error

"""A finished run as a comparison needs it, checked to be one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench import results
from trackbench.errors import InputError
from trackbench.metrics import Interval
from trackbench.metrics.stored import ROOT_MEAN_SQUARES
from trackbench.results import Result, Summary, TrackerResult
from trackbench.scenario.config import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.types import Array

#: Columns of the tables that hold text.
TEXT = {"tracker", "object", "role"}
#: Difference, relative to the value or to 1, up to which the tables and the summary of one run agree.
AGREEMENT = 1e-6


@dataclass(frozen=True)
class StoredRun:
    """A finished run."""

    label: str
    """As the user named it."""
    summary: Summary
    scenario: Scenario
    runs: pa.Table
    truth: pa.Table

    @property
    def trackers(self) -> list[str]:
        """Best first."""
        return self.summary.ranking

    def failure(self, tracker: str) -> str | None:
        """Why a tracker could not go on, if it could not."""
        failed = self._entry(tracker).failed
        return None if failed is None else failed.cause

    def coverage(self, tracker: str) -> float | None:
        """Share of the steps at which the tracker gave an estimate."""
        found = self._entry(tracker).metrics.get("coverage")
        return None if found is None else found.value

    def interval(self, tracker: str, metric: str) -> Interval | None:
        """An error of a tracker with what each run adds to it; None where there is nothing to compare.

        Raises:
            InputError: the table does not hold the metric, or is not that of this run.
        """
        known = ROOT_MEAN_SQUARES[metric]
        column, count_column = known.column, known.count
        if self.failure(tracker) is not None:
            return None
        if len(self.runs) == 0:
            return None
        rows = self.runs.filter(pc.equal(self.runs["tracker"], tracker))
        if not np.array_equal(self._column(rows, "run"), np.arange(self.summary.runs)):
            message = f"runs.parquet does not hold the {self.summary.runs} runs of {tracker}, each once and in order"
            raise InputError(message, file=self.label)
        value, count = self._column(rows, column), self._column(rows, count_column)
        if not np.all(np.isfinite(count) & (count >= 0.0) & ~np.isinf(value)):
            raise InputError(f"runs.parquet: {column} or {count_column} holds what no run leaves", file=self.label)
        found = known.of_runs(value, count)
        if found is None:
            return None
        self._require_agreement(tracker, metric, found.value)
        return found

    def _entry(self, tracker: str) -> TrackerResult:
        return next(entry for entry in self.summary.trackers if entry.name == tracker)

    def _column(self, rows: pa.Table, name: str) -> Array:
        if name not in rows.column_names:
            raise InputError(
                f"runs.parquet has no column {name}: made by another version; run it again", file=self.label
            )
        values: Array = rows[name].to_numpy().astype(np.float64)
        return values

    def _require_agreement(self, tracker: str, metric: str, value: float) -> None:
        entry = self._entry(tracker).metrics.get(metric)
        stated = None if entry is None else entry.value
        if stated is None or not abs(stated - value) <= AGREEMENT * max(abs(value), 1.0):
            message = f"runs.parquet gives {tracker} a {metric} of {value:.6g}, {results.SUMMARY} one of {stated}"
            raise InputError(f"{message}: they are not of the same run", file=self.label)


def _require_columns(table: pa.Table, file: Path) -> None:
    """A table is empty where there is nothing to keep; else its text is text and everything else numbers."""
    for field in table.schema if len(table) else ():
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        fits = pa.types.is_string if field.name in TEXT else _is_number
        if not fits(kind):
            raise InputError(f"{field.name} is a column of {kind}: not the table of a run", file=file)
    if len(table) and not TEXT & set(table.column_names):
        raise InputError(f"no column {' or '.join(sorted(TEXT))}: not the table of a run", file=file)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind))


def load(path: Path) -> StoredRun:
    """A run from its folder, or from the ``result.json`` in it.

    Raises:
        InputError: it is not one.
    """
    found = Result.load(path)
    summary, folder = found.summary, path.parent if path.name == results.SUMMARY and not path.is_dir() else path
    for name in ("runs", "truth"):
        if name not in found.tables:
            raise InputError(f"no {name}.parquet beside {results.SUMMARY}, which a comparison reads", file=folder)
        _require_columns(found.tables[name], folder / f"{name}.parquet")
    try:
        loaded = scenario_of(summary.scenario.text, Path(summary.scenario.name), summary.scenario.overrides)
    except InputError as error:
        message = f"its scenario is not one that this version reads: {error.message}"
        raise InputError(message, file=folder / results.SUMMARY, key=error.key) from None
    return StoredRun(str(path), summary, loaded.config, found.tables["runs"], found.tables["truth"])

"""What a recording shows: one run, or several of the same traffic that are laid over each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.document.palette import tracker_colours
from trackbench.results import MOST_DRAWN, Result, Tables, TrackerResult
from trackbench.results.columns import split
from trackbench.results.scenario_summary import SensorSummary
from trackbench.subjects.recording import text


@dataclass(frozen=True)
class Contents:
    """What is drawn and told."""

    name: str
    runs: str
    """How many runs the scores are over: "100", or "4 and 6" where those of several results differ."""
    recorded_run: str
    """The number of the recorded run, or the numbers."""
    vehicles: list[str]
    """Those that are tracked."""
    colours: Mapping[str, str]
    """By tracker."""
    sensors: Mapping[str, SensorSummary]
    tables: Tables
    reference: str
    """What the reference is called."""
    ranking: str
    """Markdown."""
    about: str
    """Markdown."""
    best: str | None = None
    """The best tracker."""

    @property
    def hold(self) -> float:
        """For how long an estimate is shown when none follows: the period of the slowest sensor, s."""
        return max((1.0 / sensor.rate_hz for sensor in self.sensors.values() if sensor.rate_hz), default=1.0)


def contents_of(result: Result, colours: Mapping[str, str] | None = None) -> Contents:
    """The contents of a recording of one run.

    Args:
        result: of the run.
        colours: see :func:`colours_of`.
    """
    summary = result.summary
    drawn = {tracker.name for tracker in [*result.drawn, *result.unscored][:MOST_DRAWN]}
    names = [name for name in result if name in drawn]
    return Contents(
        name=result.name,
        runs=str(summary.runs),
        recorded_run=str(summary.recorded_run),
        vehicles=list(summary.truth.objects),
        colours=colours_of(names, colours),
        sensors=summary.sensors,
        tables=_of_trackers(result.tables, names) if len(names) < len(summary.trackers) else result.tables,
        reference="" if summary.reference is None else summary.reference.label,
        ranking=text.ranking(result) if summary.identities == "known" else text.track_ranking(result),
        about=text.about(result),
        best=result.contenders[0].name if result.scored else None,
    )


def _of_trackers(tables: Tables, names: Sequence[str]) -> Tables:
    """The tables with the rows of these trackers, and of what has to do with none."""
    kept = pa.array(names)
    return Tables(
        {
            name: table.filter(pc.is_in(table["tracker"], kept)) if "tracker" in table.column_names else table
            for name, table in tables.items()
        }
    )


def colours_of(trackers: Iterable[str], colours: Mapping[str, str] | None) -> dict[str, str]:
    """The colour of each tracker: from those of several runs, which may have others as well, or else in order."""
    names = list(trackers)
    return tracker_colours(names) if colours is None else {name: colours[name] for name in names}


def labels(paths: Sequence[Path]) -> list[str]:
    """A short name for each of several runs: the part of their paths that tells them apart."""
    parts = [path.resolve().with_suffix("").parts for path in paths]
    for i in range(1, min(map(len, parts)) + 1):
        names = [part[-i] for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{path} ({number})" for number, path in enumerate(paths, start=1)]


def same_traffic(results: Sequence[Result]) -> bool:
    """Whether all show the same motion of the same objects."""
    first, *others = (split(result.tables.truth, "role", "object") for result in results)
    return all(_same(first, other, ("px_m", "py_m")) for other in others)


def laid_over(named: Mapping[str, Result]) -> Contents:
    """Runs of the same traffic in one scene; a tracker is called "its name (its run's name)"."""
    first, *others = named.values()
    drawn = split(first.tables.measurements, "sensor", "object")
    once = all(
        _same(drawn, split(other.tables.measurements, "sensor", "object"), ("time_s", "x_m", "y_m")) for other in others
    )
    trackers = [
        tracker.model_copy(update={"name": _named(tracker.name, label)})
        for label, result in named.items()
        for tracker in result.summary.trackers
    ]
    sensors = {
        name if once else _named(name, label): sensor
        for label, result in named.items()
        for name, sensor in result.summary.sensors.items()
    }
    tables = ("steps", "nis", "estimates", "recorded_nis", "modes", "recorded_modes")
    parts = dict.fromkeys(tables, "tracker")
    if not once:
        parts["measurements"] = "sensor"
    joined = {
        table: _joined({label: result.tables.if_there(table) for label, result in named.items()}, column)
        for table, column in parts.items()
    }
    called = {result.summary.held_against.label for result in named.values()}
    name, runs = " over ".join(named), _each(result.summary.runs for result in named.values())
    return Contents(
        name=name,
        runs=runs,
        recorded_run=_each(result.summary.recorded_run for result in named.values()),
        vehicles=list(first.summary.truth.objects),
        colours=tracker_colours(tracker.name for tracker in trackers),
        sensors=sensors,
        tables=Tables({**first.tables, **joined}),
        reference=called.pop() if len(called) == 1 else "reference",
        ranking="\n".join(text.ranked(name, runs, sorted(trackers, key=_error))),
        about="\n".join([*_about(named), *text.legend(trackers, sensors)]),
    )


def _about(named: Mapping[str, Result]) -> list[str]:
    """What each of the runs is, and whether their scores can be held against each other."""
    lines = [text.truth(next(iter(named.values())).summary)]
    for label, result in named.items():
        summary = result.summary
        of = f"run {summary.recorded_run} of {summary.runs}, seed {summary.seed}"
        lines.append(f"- **{label}**: {of}, measurements `{summary.fingerprint}`; `{summary.command}`")
    if len({result.summary.fingerprint for result in named.values()}) > 1:
        lines += ["", "The scores are over different measurements: a small difference between two may be chance."]
    return lines


def _each(numbers: Any) -> str:
    """ "4", or "4 and 6" where they differ."""
    return " and ".join(dict.fromkeys(map(str, numbers)))


def _named(name: str, label: str) -> str:
    return f"{name} ({label})"


def _error(tracker: TrackerResult) -> float:
    value = None if tracker.failed is not None else tracker.position_rmse.value
    return float("inf") if value is None else value


def _joined(tables: Mapping[str, pa.Table], column: str) -> pa.Table:
    """The rows of all tables, with their label after the name in a column."""
    parts = []
    for label, table in tables.items():
        if table.num_rows:
            names = pa.array([_named(str(name), label) for name in table.column(column).to_pylist()])
            plain = table.set_column(table.schema.get_field_index(column), column, names)
            parts.append({name: _undictionaried(plain[name]) for name in sorted(plain.column_names)})
    return pa.concat_tables([pa.table(part) for part in parts]) if parts else pa.table({})


def _undictionaried(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column


def _same(a: Mapping[Any, Any], b: Mapping[Any, Any], names: Sequence[str]) -> bool:
    """Whether the rows of every key have the same values in these columns."""
    return a.keys() == b.keys() and all(
        np.array_equal(a[key][name], b[key][name], equal_nan=True) for key in a for name in names
    )

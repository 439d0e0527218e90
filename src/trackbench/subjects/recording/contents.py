"""What a recording shows: one run, or several that are laid over each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

from trackbench.document.palette import tracker_colours
from trackbench.results import MOST_DRAWN, Result, Tables
from trackbench.results.scenario_summary import SensorSummary
from trackbench.subjects.recording import text, track_text


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
    said = text if summary.identities == "known" else track_text
    return Contents(
        name=result.name,
        runs=str(summary.runs),
        recorded_run=str(summary.recorded_run),
        vehicles=list(summary.truth.objects),
        colours=colours_of(names, colours),
        sensors=summary.sensors,
        tables=_of_trackers(result.tables, names) if len(names) < len(summary.trackers) else result.tables,
        reference="" if summary.reference is None else summary.reference.label,
        ranking=said.ranking(result),
        about=said.about(result),
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

"""The contents of a recording: the tables that it draws, and the texts beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa
import pyarrow.compute as pc

from trackbench.document import Code, Document, Paragraph, Section
from trackbench.document.markdown import to_markdown
from trackbench.document.palette import tracker_colours
from trackbench.metrics.function_events import FunctionEvent, function_events
from trackbench.report.first_screen import first_screen
from trackbench.report.sentences import facts
from trackbench.results import MOST_DRAWN, Result, Tables
from trackbench.results.columns import split
from trackbench.results.scenario_summary import SensorSummary
from trackbench.subjects.recording.focus import Focus, moment_of
from trackbench.subjects.recording.thinning import AROUND_S, MOST, WORST, instants, thin_tables


@dataclass(frozen=True)
class Contents:
    """Tables, colours and names of trackers and vehicles that a recording displays."""

    result: Result
    colours: Mapping[str, str]
    """Colour of each tracker that the recording displays, by name."""
    tables: Tables
    """Tables with the rows of the displayed trackers, at all instants."""
    scene: Tables
    """Tables with the rows of the displayed trackers, at the instants that :func:`thin_tables` keeps."""
    stored: Tables
    """Tables with the rows of all trackers, at the instants that :func:`thin_tables` keeps."""
    vehicles: list[str]
    """Names of the tracked vehicles."""
    sensors: Mapping[str, SensorSummary]
    hidden: bool
    """Whether the identities of the vehicles are hidden from the trackers."""
    decisions: pa.Table
    """Table of the decisions of driver assistance functions; empty without such functions."""

    @cached_property
    def moment(self) -> Focus:
        """Time and vehicle of the recorded run that are worth seeing first."""
        return moment_of(self.result)

    @property
    def plotted(self) -> Mapping[str, str]:
        """Colour of each tracker with lines in the plots, by name; no baselines, whose lines would cover others."""
        baselines = {tracker.name for tracker in self.result.summary.trackers if tracker.baseline}
        shown = {name: colour for name, colour in self.colours.items() if name not in baselines}
        return shown or self.colours

    @property
    def function_events(self) -> list[FunctionEvent]:
        """Wrong decisions of driver assistance functions in the recorded run."""
        run, functions = self.result.summary.recorded_run, split(self.decisions, "function")
        events = (event for (function,) in functions for event in function_events(self.result, function, run=run))
        return [event for event in events if event.tracker in self.colours]

    @property
    def mapped(self) -> Mapping[str, str]:
        """Colour of each tracker with a map, by name: all plotted trackers; none with hidden identities."""
        return {} if self.hidden or not self.tables.if_there("estimates").num_rows else self.plotted


def contents_of(result: Result) -> Contents:
    """Return the tables, colours and names that the recording of a run draws."""
    drawn = {tracker.name for tracker in [*result.drawn, *result.unscored][:MOST_DRAWN]}
    names = [name for name in result if name in drawn]
    colours = tracker_colours({name: result.places[name] for name in names})
    summary, stored = result.summary, thin_tables(result)
    tables, scene = (
        Tables({name: rows_of_trackers(table, names) for name, table in source.items()})
        for source in (result.tables, stored)
    )
    vehicles, hidden = list(summary.truth.objects), summary.identities == "hidden"
    decisions = tables.if_there("decisions")
    return Contents(result, colours, tables, scene, stored, vehicles, summary.sensors, hidden, decisions)


def rows_of_trackers(table: pa.Table, trackers: list[str]) -> pa.Table:
    """Return a table's rows of some trackers; a table without the column ``tracker`` is returned whole."""
    return table.filter(pc.is_in(table["tracker"], pa.array(trackers))) if "tracker" in table.column_names else table


IN_THE_PICTURE = (
    "Boxes are the true vehicles, small dots measurements of the last 0.3 s. Larger dots are estimates or tracks in"
    " their 95 % ellipses; a track with a smaller existence probability is fainter. Lines are paths of the last 2 s."
    " Switches, losses and false tracks are marked for 1 s. In the plots, grey lines are the reference and bounds; a"
    " bound of one tracker has its colour, and a baseline has no lines. Peaks may be beyond the axis: zoom out."
)


def ranking_text(result: Result) -> str:
    """Return the verdict of a run, its expectations and its ranked trackers, as Markdown."""
    return to_markdown(
        Document("recording", result.name, tuple(first_screen(result.listed, len(result.summary.trackers), None)))
    )


def description_text(contents: Contents) -> str:
    """Return a description of the run and the picture, and the command that repeats the run, as Markdown."""
    result, summary = contents.result, contents.result.summary
    shown = f"Shown: Monte-Carlo run {summary.recorded_run} of {summary.runs}, seed {summary.seed}."
    blocks = (
        Paragraph(shown),
        Section("In the picture", (Paragraph(IN_THE_PICTURE), *_left_out(contents))),
        Section("Again", (Code(summary.command, "sh"), Paragraph(summary.made_with))),
        Paragraph(f"Fingerprint of the measurements: {summary.fingerprint}"),
    )
    lead, in_short = summary.scenario.description, facts(result, len(result.summary.trackers))
    return to_markdown(Document("recording", result.name, blocks, lead, in_short))


def _left_out(contents: Contents) -> list[Paragraph]:
    """Return a paragraph on the instants that a long run's recording leaves out; nothing for a short run."""
    drawn, number = (len(instants(tables)) for tables in (contents.stored, contents.result.tables))
    text = (
        f"Of {number:,} instants {drawn:,} are in this file: evenly spaced, within {AROUND_S:g} s of the moment worth"
        f" seeing first, and the {WORST} worst of each tracker and vehicle. Lines of plots have the lowest and the"
        f" highest value in each of {MOST // 2:,} stretches of time. The folder of the run has every instant."
    )
    return [Paragraph(text)] if drawn < number else []

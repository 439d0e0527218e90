"""What a recording shows of a run, and the texts beside it."""

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
from trackbench.subjects.recording.views import ErrorMap


@dataclass(frozen=True)
class Contents:
    """What is drawn of a run."""

    result: Result
    colours: Mapping[str, str]
    """Colour by tracker, of those that are drawn."""
    tables: Tables
    """Tables with the rows of the drawn trackers."""

    @property
    def vehicles(self) -> list[str]:
        """Names of the vehicles that are tracked."""
        return list(self.result.summary.truth.objects)

    @property
    def sensors(self) -> Mapping[str, SensorSummary]:
        """Sensors by name."""
        return self.result.summary.sensors

    @property
    def hidden(self) -> bool:
        """Whether the identities of the vehicles are hidden from the trackers."""
        return self.result.summary.identities == "hidden"

    @property
    def best(self) -> str | None:
        """Name of the best tracker."""
        return self.result.contenders[0].name if self.result.scored else None

    @cached_property
    def moment(self) -> Focus:
        """A moment that is worth seeing first."""
        return moment_of(self.result)

    @property
    def baselines(self) -> frozenset[str]:
        """Names of the trackers that filter nothing, beside others."""
        own = {tracker.name: tracker.baseline for tracker in self.result.summary.trackers}
        return frozenset(name for name, baseline in own.items() if baseline and not all(own.values()))

    @property
    def plotted(self) -> Mapping[str, str]:
        """Colour by tracker, of those that have lines in the plots: a baseline would cover the others."""
        return {name: colour for name, colour in self.colours.items() if name not in self.baselines}

    @property
    def decisions(self) -> pa.Table:
        """Decisions of functions; without rows where there are none."""
        return self.tables.if_there("decisions")

    @property
    def function_events(self) -> list[FunctionEvent]:
        """Events of functions in the recorded run in which something was wrong."""
        run, functions = self.result.summary.recorded_run, split(self.decisions, "function")
        events = (event for (function,) in functions for event in function_events(self.result, function, run=run))
        return [event for event in events if event.tracker in self.colours]

    @cached_property
    def errors(self) -> ErrorMap | None:
        """The map of errors; None where identities are hidden, or there are no errors."""
        shown = [] if self.hidden else [*self.plotted]
        return ErrorMap(self.tables, shown, self.hold) or None

    @property
    def hold(self) -> float:
        """For how long an estimate is shown when none follows: the period of the slowest sensor, s."""
        return max((1.0 / sensor.rate_hz for sensor in self.sensors.values() if sensor.rate_hz), default=1.0)

    @property
    def runs(self) -> str:
        """What the scores are over: "1 run" or "All 100 runs"."""
        return "1 run" if self.result.summary.runs == 1 else f"All {self.result.summary.runs} runs"


def contents_of(result: Result) -> Contents:
    """Return the contents of a recording of one run."""
    drawn = {tracker.name for tracker in [*result.drawn, *result.unscored][:MOST_DRAWN]}
    names = [name for name in result if name in drawn]
    colours = tracker_colours({name: result.places[name] for name in names})
    return Contents(result, colours, Tables({name: _of(table, names) for name, table in result.tables.items()}))


def _of(table: pa.Table, trackers: list[str]) -> pa.Table:
    return table.filter(pc.is_in(table["tracker"], pa.array(trackers))) if "tracker" in table.column_names else table


IN_THE_SCENE = (
    "Boxes are the true vehicles, the arrow points where the body points. Small dots are measurements of the last"
    " 0.3 s. Larger dots are estimates, in the colours of the plots, each in its 95 % ellipse of position. Lines are"
    " the true and the estimated paths of the last 2 s."
)
IN_THE_PLOTS = (
    "Grey lines are the reference and bounds; one of one tracker alone has its colour. All have one time axis. Peaks"
    " may be beyond the axis of values: zoom out to see them."
)
IN_THE_SCENE_OF_TRACKS = (
    "A tab for each tracker, whose colour is that of its lines in the plots. Boxes are the true vehicles, small dots"
    " detections of the last 0.3 s, false alarms among them. Larger dots are tracks with their numbers and 95 %"
    " ellipses, in pale colours by identity; a track that states a smaller existence probability is fainter. Lines are"
    " the paths of the last 2 s, true and tracked. A red ring is a due vehicle without a track. Switches, losses and"
    " false tracks are marked for 1 s. The view on the right also has the gates of the built-in trackers' tracks, and a"
    " line from each track to the detection that it took, where the tracker says so."
)


def ranking_text(result: Result) -> str:
    """Return the verdict of a run, its expectations and its trackers in order, as Markdown."""
    return to_markdown(
        Document("recording", result.name, tuple(first_screen(result.listed, len(result.summary.trackers), None)))
    )


def about_text(result: Result) -> str:
    """Return what was run, what the picture shows, and how to run it again, as Markdown."""
    summary = result.summary
    shown = f"Shown: Monte-Carlo run {summary.recorded_run} of {summary.runs}, seed {summary.seed}."
    hidden = summary.identities == "hidden"
    plots = () if hidden else (Section("In the plots", (Paragraph(IN_THE_PLOTS),)),)
    blocks = (
        Paragraph(shown),
        Section("In the scene", (Paragraph(IN_THE_SCENE_OF_TRACKS if hidden else IN_THE_SCENE),)),
        *plots,
        Section("Again", (Code(summary.command, "sh"), Paragraph(summary.made_with))),
        Paragraph(f"Fingerprint of the measurements: {summary.fingerprint}"),
    )
    lead, in_short = summary.scenario.description, facts(result, len(result.summary.trackers))
    return to_markdown(Document("recording", result.name, blocks, lead, in_short))

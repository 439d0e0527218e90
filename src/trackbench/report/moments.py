"""What went wrong most in the recorded run: the largest errors and, with hidden identities, the costliest events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import pyarrow.compute as pc

from trackbench.document import Block, Cell, Code, Column, Paragraph, Section, Table
from trackbench.metrics.function_events import TrackEvent, events_of
from trackbench.metrics.recorded_run import EstimateMoment, recorded_estimates, worst
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, percent, rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.results import Result


def worst_moments(result: Result) -> dict[str, EstimateMoment]:
    """By tracker, best first, the scored moment of its largest position error in the recorded run."""
    if not result.scored:
        return {}
    estimates = recorded_estimates(result)
    return {name: top for name in (tracker.name for tracker in result.scored) for top in worst(estimates, [name], 1)}


def diverged_elsewhere(result: Result) -> str:
    """Which of those that filter diverged in other runs than the recorded one: "Not shown: div diverged in run 7."."""
    runs: dict[str, list[int]] = {}
    filtering = {tracker.name for tracker in result.filtering}
    table = result.tables.if_there("runs")
    for row in table.filter(pc.greater(table["diverged"], 0)).to_pylist() if table.num_rows else ():
        if row["tracker"] in filtering and row["run"] != result.summary.recorded_run:
            runs.setdefault(row["tracker"], []).append(int(row["run"]))
    parts = [
        f"{name} diverged in run {first}{f' and {len(more)} more' * bool(more)}"
        for name, (first, *more) in runs.items()
    ]
    return f"Not shown: {joined_names(parts)}." if parts else ""


def moment_text(moment: EstimateMoment) -> str:
    """Such as "3.18 m, v5 at 7.40 s"."""
    return f"{rounded(moment.position_error_m, 2)} m, {moment.object} at {rounded(moment.time_s, 2)} s"


def moments_section(result: Result, moments: Mapping[str, EstimateMoment], ringed: Sequence[str]) -> Iterator[Section]:
    """The worst moments, and the commands that show them in the recording.

    Args:
        result: of the run.
        moments: by tracker.
        ringed: the trackers whose moments the map rings.
    """
    if not moments:
        return
    sentences = (
        f"The largest position errors in run {result.summary.recorded_run}.",
        diverged_elsewhere(result),
        "In the folder of this run, these commands list more, and open the recording at the rings of the map:",
    )
    text = " ".join(filter(None, sentences))
    views = (f"trackbench view . --worst --tracker {name}" for name in ringed if name in moments)
    commands = "\n".join(["trackbench inspect . --worst 3", *views])
    every = list(moments.values())
    columns = [
        (TRACKER, [Cell(name, tracker=name) for name in moments]),
        (Column("time, s"), [Cell(rounded(moment.time_s, 2)) for moment in every]),
        (Column("vehicle", left=True), [Cell(moment.object) for moment in every]),
        (Column("position error, m"), _number_cells([moment.position_error_m for moment in every])),
        (Column("velocity error, m/s"), _number_cells([moment.velocity_error_mps for moment in every])),
        (Column("NEES, 4 expected"), _number_cells([moment.nees for moment in every])),
    ]
    table = Table.of_columns("worst-moments", columns)
    yield Section("Worst moments", (table, Paragraph(text), Code(commands, "sh")))


def _number_cells(values: Sequence[float | None]) -> list[Cell]:
    places = decimals(values)
    missing = Cell(NOT_AVAILABLE, reason="the tracker does not give what this needs")
    return [missing if value is None else Cell(rounded(value, places)) for value in values]


#: Events of each tracker that are listed.
LISTED = 3
#: The most rows of causes.
MOST_CAUSES = 24


def events_section(result: Result) -> Iterator[Section]:
    """The costliest events of the recorded run with the commands that show them, and what all runs' events cost."""
    run = result.summary.recorded_run
    events = {tracker.name: events_of(result, tracker.name, run)[:LISTED] for tracker in result.scored}
    rows = [(name, event) for name, own in events.items() for event in own]
    if not rows:
        return
    text = (
        "The cost of an event is the squared GOSPA of the missed objects and false tracks until it ends, or of the "
        "switch in squared T-GOSPA. In the folder of this run, trackbench inspect . --worst 10 lists more, and "
        "these commands open the recording at the first event of each tracker:"
    )
    first = [(name, own[0]) for name, own in events.items() if own][:LISTED]
    commands = [
        f"trackbench view . --worst --tracker {name}  # {event.kind} at {event.time_s:.2f} s" for name, event in first
    ]
    columns: dict[Column, Callable[[tuple[str, TrackEvent]], str]] = {
        TRACKER: lambda row: row[0],
        Column("event", left=True): lambda row: row[1].kind,
        Column("time, s"): lambda row: rounded(row[1].time_s, 2),
        Column("vehicle", left=True): lambda row: row[1].object or "none",
        Column("track"): lambda row: "none" if row[1].track is None else str(row[1].track),
        Column("cost, m²"): lambda row: rounded(row[1].cost_m2, 1),
        Column("why", left=True): lambda row: row[1].reason,
    }
    table = text_table("costliest-events", rows, columns)
    blocks: tuple[Block, ...] = (Paragraph(text), Code("\n".join(commands), "sh"), table, *_causes(result))
    yield Section(f"Costliest events of run {run}", blocks)


def _causes(result: Result) -> Iterator[Table]:
    """What the missed objects, false tracks and switches of each tracker come from; nothing where there are none."""
    rows: list[tuple[str, ...]] = []
    trackers = result.drawn
    for tracker in trackers:
        events = [event for event in events_of(result, tracker.name) if event.cost_m2 > 0]
        total = sum(event.cost_m2 for event in events)
        times = Counter((event.kind, event.cause) for event in events)
        costs = {key: [event.cost_m2 for event in events if (event.kind, event.cause) == key] for key in times}
        costliest = sorted(times, key=lambda key: -float(np.sum(costs[key])))
        for kind, why in costliest[: max(1, MOST_CAUSES // max(1, len(trackers)))]:
            share = percent(sum(costs[kind, why]) / total)
            rows.append((tracker.name, kind, why, str(times[kind, why]), share))
    columns: dict[Column, Callable[[tuple[str, ...]], str]] = {
        TRACKER: lambda row: row[0],
        Column("event", left=True): lambda row: row[1],
        Column("why", left=True): lambda row: row[2],
        Column("times", "in all runs"): lambda row: row[3],
        Column("share of the cost", "of all events of the tracker, in all runs"): lambda row: row[4],
    }
    if rows:
        caption = "What missed objects, false tracks and switches come from, in all runs"
        yield text_table("causes", rows, columns, caption)

"""The events of a run that cost most, and how to look at them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from trackbench.document import Block, Cell, Code, Column, Paragraph, Section, Table
from trackbench.metrics.track_events import TrackEvent, events_of
from trackbench.report.numbers import fixed, percent
from trackbench.report.run.cells import TRACKER
from trackbench.results import Result

#: Events of each tracker that are listed.
LISTED = 3
#: The most rows of causes.
MOST_CAUSES = 24


class _Cause(NamedTuple):
    tracker: str
    kind: str
    why: str
    times: int
    cost: float
    share: float


def costliest(result: Result) -> dict[str, list[TrackEvent]]:
    """By scored tracker the events of the recorded run that cost most, best tracker first."""
    run = result.summary.recorded_run
    found = {tracker.name: events_of(result, tracker.name, run)[:LISTED] for tracker in result.scored}
    return {name: events for name, events in found.items() if events}


def events_section(result: Result) -> Iterator[Section]:
    """The costliest events of the recorded run with the commands that show them, and what all runs' events cost."""
    found = costliest(result)
    if not found:
        return
    run = result.summary.recorded_run
    blocks: list[Block] = [
        Paragraph(
            "The cost of an event is the squared GOSPA of the missed objects and false tracks until it ends, or of the "
            "switch in squared T-GOSPA. In the folder of this run, trackbench inspect . --worst 10 lists more, and "
            "these commands open the recording at the first event of each tracker:"
        ),
        Code("\n".join(_command(name, events[0]) for name, events in list(found.items())[:LISTED]), "sh"),
        _table(found),
        *([causes] if (causes := _causes(result)) else []),
    ]
    yield Section(f"Costliest events of run {run}", tuple(blocks))


def _command(tracker: str, event: TrackEvent) -> str:
    return f"trackbench view . --worst --tracker {tracker}  # {event.kind} at {event.time_s:.2f} s"


def _table(found: dict[str, list[TrackEvent]]) -> Table:
    rows = [(name, event) for name, events in found.items() for event in events]
    columns = [
        (TRACKER, [Cell(name, tracker=name) for name, _ in rows]),
        (Column("event", left=True), [Cell(event.kind) for _, event in rows]),
        (Column("time, s"), [Cell(fixed(event.time_s, 2)) for _, event in rows]),
        (Column("vehicle", left=True), [Cell(event.object or "none") for _, event in rows]),
        (Column("track"), [Cell("none" if event.track is None else str(event.track)) for _, event in rows]),
        (Column("cost, m²"), [Cell(fixed(event.cost_m2, 1)) for _, event in rows]),
        (Column("why", left=True), [Cell(event.reason) for _, event in rows]),
    ]
    return Table.of_columns("costliest-events", columns)


def _causes(result: Result) -> Table | None:
    """What the missed objects, false tracks and switches of each tracker come from."""
    found: list[_Cause] = []
    for tracker in result.drawn:
        events = [event for event in events_of(result, tracker.name) if event.cost_m2 > 0]
        total = sum(event.cost_m2 for event in events)
        for kind, why in dict.fromkeys((event.kind, event.cause) for event in events):
            costs = [event.cost_m2 for event in events if (event.kind, event.cause) == (kind, why)]
            found.append(_Cause(tracker.name, kind, why, len(costs), float(np.sum(costs)), sum(costs) / total))
    if not found:
        return None
    order = {tracker.name: rank for rank, tracker in enumerate(result.drawn)}
    found.sort(key=lambda cause: (order[cause.tracker], -cause.cost))
    first = {name: [cause for cause in found if cause.tracker == name] for name in order}
    each = max(1, MOST_CAUSES // max(1, len(first)))
    shown = [cause for causes in first.values() for cause in causes[:each]]
    columns = [
        (TRACKER, [Cell(cause.tracker, tracker=cause.tracker) for cause in shown]),
        (Column("event", left=True), [Cell(cause.kind) for cause in shown]),
        (Column("why", left=True), [Cell(cause.why) for cause in shown]),
        (Column("times", "in all runs"), [Cell(str(cause.times)) for cause in shown]),
        (
            Column("share of the cost", "of all events of the tracker, in all runs"),
            [Cell(percent(cause.share)) for cause in shown],
        ),
    ]
    return Table.of_columns("causes", columns, "What missed objects, false tracks and switches come from, in all runs")
